"""Depth and heading autopilots for torpedo-shaped vehicles, with dither on every fin."""

from typing import Annotated

import numpy as np
from pydantic import Field

from ..bounds import Number, Positive, Tones, config
from ..numerics.spatial import rotation
from ..parameters import Array
from ..structure.single_body import SingleBody, single_body
from ..structure.system import SecondOrderSystem
from .driver import Driver, DriverConfig
from .signals import Multisine

_DAMPING = 1.0  # of the attitude loops
_SHARE = 0.1  # bandwidth of the depth loop over that of the attitude loops
_STEEPEST = 0.3  # largest pitch that the depth autopilot commands [rad]
_SLOWEST = 0.2  # smallest propeller command: fins need inflow
_DRIVEN = 4.0  # dither amplitude before clipping, over its bound: clipping puts more power into it


@config
class DepthHeadingAutopilot(DriverConfig):
    """Depth and heading follow slow multisines; dither is added to fins and propeller.

    Attributes:
        propeller: mean propeller command, in (0.2, 1].
        swing: bound on the propeller's dither.
        dither: bound on each fin's dither [rad].
        low: lowest dither frequency [Hz].
        high: highest dither frequency [Hz].
        tones: number of sines in each signal.
        slow: ratio of the dither frequencies to those of the depth and heading references.
        depth: mean depth [m].
        dive: amplitude of the depth reference about the mean [m].
        turn: amplitude of the heading reference about 0 [rad].
        bandwidth: bandwidth of the attitude loops [rad/s].
    """

    propeller: Annotated[float, Field(strict=True, gt=_SLOWEST, le=1)] = 0.8
    swing: Positive = 0.2
    dither: Positive = 0.2
    low: Positive = 0.1
    high: Positive = 2.0
    tones: Tones = 8
    slow: Positive = 40.0
    depth: Number = 20.0
    dive: Positive = 5.0
    turn: Positive = 1.5
    bandwidth: Positive = 1.0

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; raises `InvalidInput` unless it is a torpedo, and no band is empty."""
        wanted = ("propeller gain", "fin lift", "quadratic drag", "righting moment")
        torpedo = single_body(system, wanted, "a torpedo to steer")
        return _Autopilot(self, torpedo, prior, rng)


class _Autopilot(Driver):
    """Second-order pitch and yaw loops under the prior; the fins share the moments.

    The righting moment controls roll.
    """

    def __init__(
        self,
        config: DepthHeadingAutopilot,
        system: SingleBody,
        prior: Array,
        rng: np.random.Generator,
    ):
        self._config, self._limit = config, float(system.operation.command[1][0])
        low, high, tones, slow = config.low, config.high, config.tones, config.slow
        self._dither = Multisine(system.n_u, low, high, tones, _DRIVEN, rng)
        self._course = Multisine(2, low / slow, high / slow, tones, 1.0, rng)
        self._reach = np.full(system.n_u, config.dither)
        self._reach[-1] = config.swing
        self._least, self._most = np.full((2, system.n_u), [[-self._limit], [self._limit]])
        self._least[-1], self._most[-1] = _SLOWEST, 1.0
        place = system.space.index
        self._inertia, self._righting = prior[place("M_55")], prior[place("righting_z")]
        lever = np.cross(system.constants("fin", "point"), system.constants("fin", "direction"))
        lift = lever.T * prior[system.space["fin lift"]]
        self._share = np.linalg.pinv(lift)[:, 1:]  # pitch and yaw only; [rad/(N·m)] at 1 m/s
        self._cruise = _balance(
            prior[place("thrust")],
            prior[place("dq_along")],
            float(system.constants("propeller", "slip")[0]),
            config.propeller,
        )

    def start(self) -> tuple[Array, Array]:
        place, velocity = np.zeros(6), np.zeros(6)
        place[2], velocity[0] = -self._config.depth, self._cruise
        return place, velocity

    def command(self, t: float, q: Array, v: Array) -> Array:
        config, omega = self._config, self._config.bandwidth
        R = rotation(q[3:])
        speed = max(float(v[0]), 0.3 * self._cruise)
        dive, turn = self._course(t)
        climb = _SHARE * omega * (config.dive * dive - config.depth - q[2]) / speed
        pitch = -np.arcsin(min(max(R[2, 0], -1.0), 1.0))  # nose down
        error = np.array(
            [
                -min(max(climb, -_STEEPEST), _STEEPEST) - pitch,
                _wrapped(config.turn * turn - np.arctan2(R[1, 0], R[0, 0])),
            ]
        )
        moment = self._inertia * omega * (omega * error - 2 * _DAMPING * v[4:])
        moment[0] += self._righting * np.sin(pitch)
        u = self._reach * _clipped(self._dither(t), -1.0, 1.0)
        u[:-1] += _clipped(self._share @ moment / speed**2, -self._limit, self._limit)
        u[-1] += config.propeller
        return _clipped(u, self._least, self._most)


def _balance(thrust: float, drag: float, slip: float, n: float) -> float:
    """Speed u [m/s] at which the drag, drag·u², balances the thrust at propeller command n > 0."""
    loss, push = thrust * slip * n, thrust * n**2
    return float(2 * push / (loss + np.sqrt(loss**2 + 4 * drag * push)))


def _clipped(x: Array, low: Array | float, high: Array | float) -> Array:
    """np.clip in a third of its time for short x."""
    return np.minimum(np.maximum(x, low), high)


def _wrapped(angle: float) -> float:
    """The angle [rad] wrapped to [−π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
