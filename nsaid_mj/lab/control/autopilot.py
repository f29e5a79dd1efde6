"""Depth and heading autopilots for torpedo-shaped vehicles, with dither on every fin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from ...base import Number, Positive, config
from ...core import Array
from ..fields import Tones
from .driver import Driver, DriverConfig, Feedback

if TYPE_CHECKING:
    from ...core import SecondOrderSystem

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
        from ...core import SingleBody
        from .signals import Multisine

        wanted = ("propeller gain", "fin lift", "quadratic drag", "righting moment")
        torpedo = SingleBody.of(system, wanted, "a torpedo to steer")
        limit = float(torpedo.operation.command[1][0])
        place = torpedo.space.index
        low = self.low
        high = self.high
        slow = self.slow
        dither = Multisine(torpedo.n_u, low, high, self.tones, _DRIVEN, rng)
        course = Multisine(2, low / slow, high / slow, self.tones, 1.0, rng)
        reach = np.full(torpedo.n_u, self.dither)
        reach[-1] = self.swing
        least, most = np.full((2, torpedo.n_u), [[-limit], [limit]])
        least[-1] = _SLOWEST
        most[-1] = 1.0
        inertia = prior[place("M_55")]
        righting = prior[place("righting_z")]
        lever = np.cross(torpedo.constants("fin", "point"), torpedo.constants("fin", "direction"))
        lift = lever.T * prior[torpedo.space["fin lift"]]
        share = np.linalg.pinv(lift)[:, 1:]  # pitch and yaw only; [rad/(N·m)] at 1 m/s
        slip = float(torpedo.constants("propeller", "slip")[0])
        thrust = prior[place("thrust")]
        drag = prior[place("dq_along")]
        cruise = _balance(thrust, drag, slip, self.propeller)
        begin = np.zeros(6), np.zeros(6)
        begin[0][2] = -self.depth
        begin[1][0] = cruise

        def command(t: float, q: Array, v: Array) -> Array:
            """Second-order pitch and yaw loops under the prior; the fins share the moments.

            The righting moment controls roll.
            """
            speed = max(float(v[0]), 0.3 * cruise)
            pitch, errors = self._errors(course(t), q, speed)
            omega = self.bandwidth
            moment = inertia * omega * (omega * errors - 2 * _DAMPING * v[4:])
            moment[0] += righting * np.sin(pitch)
            u = reach * _clipped(dither(t), -1.0, 1.0)
            u[:-1] += _clipped(share @ moment / speed**2, -limit, limit)
            u[-1] += self.propeller
            return _clipped(u, least, most)

        return Feedback(lambda: (begin[0].copy(), begin[1].copy()), command)

    def _errors(self, course: Array, q: Array, speed: float) -> tuple[float, Array]:
        """Pitch, nose down, and errors of pitch and heading (2,) [rad] on a course (2,) in ±1."""
        from ...core import rotation

        R = rotation(q[3:])
        dive, turn = course
        climb = _SHARE * self.bandwidth * (self.dive * dive - self.depth - q[2]) / speed
        pitch = -np.arcsin(min(max(R[2, 0], -1.0), 1.0))
        heading = self.turn * turn - np.arctan2(R[1, 0], R[0, 0])
        steep = min(max(climb, -_STEEPEST), _STEEPEST)
        return pitch, np.array([-steep - pitch, _wrapped(heading)])


def _balance(thrust: float, drag: float, slip: float, n: float) -> float:
    """Speed u [m/s] at which the drag, drag·u², balances the thrust at propeller command n > 0."""
    loss = thrust * slip * n
    push = thrust * n**2
    return float(2 * push / (loss + np.sqrt(loss**2 + 4 * drag * push)))


def _clipped(x: Array, low: Array | float, high: Array | float) -> Array:
    """np.clip in a third of its time for short x."""
    return np.minimum(np.maximum(x, low), high)


def _wrapped(angle: float) -> float:
    """The angle [rad] wrapped to [−π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
