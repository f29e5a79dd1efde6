"""Torpedoes under way: depth and heading autopilots, with a dither on every fin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InvalidInput
from ..excitation import Multisine
from ..parameters import Array
from ..spatial import rotation
from ..system import SecondOrderSystem
from ..systems.torpedo import TorpedoVehicle
from .driver import Driver, DriverConfig

_DAMPING = 1.0  # of the attitude loops
_SHARE = 0.25  # of the attitude loops' bandwidth that the depth loop has
_STEEPEST = 0.5  # pitch that the depth autopilot asks for at most [rad]
_SLOWEST = 0.2  # command of the propeller, at least: fins need a flow


@dataclass(frozen=True)
class DepthHeadingAutopilot(DriverConfig):
    """Depth and heading follow slow multisines, the propeller another; the fins dither on top.

    Attributes:
        propeller: mean command of the propeller, in (0.2, 1].
        swing: of the propeller's command about it.
        dive: reach of the depth reference [m].
        turn: reach of the heading reference [rad].
        low: lowest frequency of the dither [Hz].
        high: highest frequency of the dither [Hz].
        slow: how many times slower references and propeller vary than the dither.
        tones: number of sines in each signal.
        dither: reach of the dither of each fin [rad].
        bandwidth: of the attitude loops [rad/s].
        depth: mean depth [m].
    """

    propeller: float = 0.6
    swing: float = 0.35
    dive: float = 5.0
    turn: float = 1.5
    low: float = 0.1
    high: float = 1.0
    slow: float = 10.0
    tones: int = 8
    dither: float = 0.1
    bandwidth: float = 0.5
    depth: float = 20.0

    def __post_init__(self) -> None:
        for name, remedy in (
            ("dive", "5 m will do."), ("turn", "1.5 rad will do."), ("slow", "10 will do."),
            ("dither", "0.1 rad will do."), ("bandwidth", "0.5 rad/s suits a REMUS 100."),
            ("depth", "20 m will do."),
        ):  # fmt: skip
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"excitation.{name}", "a number > 0", value, remedy)
        if not _SLOWEST < self.propeller <= 1:
            raise InvalidInput("excitation.propeller", f"a command in ({_SLOWEST}, 1]",
                               self.propeller, "0.6 is cruising.")  # fmt: skip
        if not 0 < self.swing <= 1:
            raise InvalidInput("excitation.swing", "a share in (0, 1]", self.swing, "0.35?")

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the system is no torpedo.
        """
        if not isinstance(system, TorpedoVehicle):
            raise InvalidInput("excitation", "a torpedo to steer", type(system).__name__,
                               "Use MultisineCommand.")  # fmt: skip
        return _Autopilot(self, system, prior, rng)


class _Autopilot(Driver):
    """Moments for a second-order attitude under the prior, shared out to the fins."""

    def __init__(
        self,
        config: DepthHeadingAutopilot,
        system: TorpedoVehicle,
        prior: Array,
        rng: np.random.Generator,
    ):
        self._config, self._limit = config, system.limit
        fins, low, high, slow = system.n_u - 1, config.low, config.high, config.slow
        tones = config.tones
        self._dither = Multisine(fins, low, high, tones, config.dither, rng)
        self._course = Multisine(3, low / slow, high / slow, tones, 1.0, rng)
        space = system.space
        believed = {name: float(prior[space.index(name)]) for name in space.names}
        roll, turning = believed["M_44"], believed["M_55"]
        self._inertia = np.array([roll, turning, turning])
        moments = system.allocation[0, 3:] * prior[space["fin lift"]]  # for each rad and (m/s)²
        self._share = np.linalg.pinv(moments)
        # Where drag and the prior's thrust balance at the mean command.
        n, drag, loss = config.propeller, believed["dq_along"], believed["thrust loss"]
        push = believed["thrust"] * n**2
        self._cruise = 2 * push / (loss * n + np.sqrt((loss * n) ** 2 + 4 * drag * push))

    def start(self) -> tuple[Array, Array]:
        place, velocity = np.zeros(6), np.zeros(6)
        place[2], velocity[0] = -self._config.depth, self._cruise
        return place, velocity

    def command(self, t: float, q: Array, v: Array) -> Array:
        config = self._config
        dive, turn, pace = self._course(t)
        R = rotation(q[3:])
        speed = max(float(v[0]), 0.3 * self._cruise)
        climb = config.dive * dive - config.depth - q[2]
        slope = _SHARE * config.bandwidth * climb / speed
        error = np.array(
            [
                -np.arctan2(R[2, 1], R[2, 2]),
                -np.clip(slope, -_STEEPEST, _STEEPEST) + np.arcsin(np.clip(R[2, 0], -1, 1)),
                _wrapped(config.turn * turn - np.arctan2(R[1, 0], R[0, 0])),
            ]
        )
        omega = config.bandwidth
        moment = self._inertia * (omega**2 * error - 2 * _DAMPING * omega * v[3:])
        fins = self._share @ moment / speed**2 + self._dither(t)
        n = np.clip(config.propeller + config.swing * pace, _SLOWEST, 1)
        return np.r_[np.clip(fins, -self._limit, self._limit), n]


def _wrapped(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi
