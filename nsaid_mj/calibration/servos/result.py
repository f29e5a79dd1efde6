"""The identified servos of an arm, with intervals."""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from ...evaluation.result import Parameter, Result
from ...parameters import Array
from ...robot.model import RobotModel
from .logs import ServoLog


@dataclass(frozen=True)
class Servo:
    """A joint's servo in MuJoCo's terms: force = kp (u(t − delay) − q) − kv q̇, and friction."""

    name: str  # name of the joint
    kp: float  # stiffness [N·m/rad or N/m]
    kv: float  # damping of servo and joint together [N·m·s/rad or N·s/m]
    armature: float  # reflected rotor inertia [kg·m² or kg]
    friction: float  # Coulomb friction [N·m or N]
    delay: float  # delay of the target [s]
    # whether gravity determines kp; otherwise kp is a convention, and so is the scale of all others
    # except the delay
    gravity: bool
    error: float  # mean absolute error of the open-loop simulation [rad or m]
    # the same without a model: the target at the best delay, or a constant position, whichever is
    # closer
    simple: float
    # largest force, where the servo saturated in the logs [N·m or N]; None elsewhere
    limit: float | None = None


@dataclass(frozen=True, kw_only=True)
class ServoIdentification(Result):
    """Result of `identify_servos`; parameters are T, f/kp, kp, armature/kp, delay, armature."""

    robot: RobotModel
    servos: tuple[Servo, ...]  # servos of every joint, in the order of `robot.joints`
    # T, f/kp and kp of every joint by the filter at the end of the logs; empty without it
    law: tuple[Parameter, ...] = ()
    # the true masses over those of the model file, if a load was weighed; kp, kv, armature and
    # friction are those under the true masses
    scale: tuple[Parameter, ...]
    # (N,) 1 of samples in use, 0 of those excluded because of external forces, of the logs in their
    # order
    used: Array
    seconds: float  # duration of the identification [s]

    @property
    def masked(self) -> float:
        """Share of excluded samples."""
        return float(1 - self.used.mean())

    def summary(self) -> dict[str, Any]:
        """Everything, for JSON."""
        return {
            "robot": self.robot.name,
            "law": "output error",
            "explains": self.explains,
            "verdict": self.verdict,
            "servos": [asdict(servo) for servo in self.servos],
            "parameters": [parameter.document() for parameter in (*self.parameters, *self.scale)],
            "efficient": [parameter.document() for parameter in self.law],
            "masked": self.masked,
            "findings": [asdict(finding) for finding in self.findings],
            "seconds": self.seconds,
        }


class Replayed(NamedTuple):
    """Logs, and simulations of the exported file driven by their targets alone."""

    logs: tuple[ServoLog, ...]  # without loads
    simulated: tuple[Array, ...]  # (N, n) simulated positions of every log [rad or m]
    used: Array  # (N,) 1 of samples in use, 0 of those that the fit left out, of all logs in a row
