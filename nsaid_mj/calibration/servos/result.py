"""What the logs of a servo arm say of every servo, with intervals."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from ..data import RobotModel
from ..findings import Finding
from ..problem import Explains
from ..result import Parameter


@dataclass(frozen=True)
class Servo:
    """One joint's servo as MuJoCo has it: force = kp (u(t − delay) − q) − kv q̇, and its friction.

    Attributes:
        name: of the joint.
        kp: stiffness [N·m/rad or N/m].
        kv: damping of servo and joint together [N·m·s/rad or N·s/m].
        armature: reflected rotor inertia [kg·m² or kg].
        friction: Coulomb friction [N·m or N].
        delay: of the target [s].
        gravity: whether gravity tells kp; otherwise kp is a convention, and so is the scale of all
            others but the delay.
        error: mean absolute error of the open-loop simulation [rad or m].
        simple: the same of what needs no model: the target at the delay that suits best, or a
            constant position, whichever is closer.
        limit: largest force, where the servo saturated in the logs [N·m or N]; None elsewhere.
    """

    name: str
    kp: float
    kv: float
    armature: float
    friction: float
    delay: float
    gravity: bool
    error: float
    simple: float
    limit: float | None = None


@dataclass(frozen=True)
class ServoIdentification:
    """Result of `identify_servos`.

    Attributes:
        robot: the model.
        explains: whether the structure explains the logs.
        verdict: the same in one sentence, with the figures that carry it.
        servos: of every joint, in the order of `robot.joints`.
        parameters: T = kv/kp, f/kp, kp, armature/kp, delay and armature of every joint, with
            intervals.
        scale: the true masses over those of the model file, if a load was weighed; kp, kv, armature
            and friction are those under the true masses.
        masked: share of the samples left out because of foreign forces.
        findings: everything noticed, refusals first.
        seconds: what the identification took [s].
    """

    robot: RobotModel
    explains: Explains
    verdict: str
    servos: tuple[Servo, ...]
    parameters: tuple[Parameter, ...]
    scale: tuple[Parameter, ...]
    masked: float
    findings: tuple[Finding, ...]
    seconds: float

    def text(self) -> str:
        """The result as JSON text."""
        content: dict[str, Any] = {
            "robot": self.robot.name,
            "law": "output error",
            "explains": self.explains,
            "verdict": self.verdict,
            "servos": [asdict(servo) for servo in self.servos],
            "parameters": [asdict(parameter) for parameter in (*self.parameters, *self.scale)],
            "masked": self.masked,
            "findings": [asdict(finding) for finding in self.findings],
            "seconds": self.seconds,
        }
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
