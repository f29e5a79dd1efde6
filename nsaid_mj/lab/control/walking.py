"""Squats, a trot, and waving one leg after another: joint targets in open loop, under PD control.

All lengths are shares of the standing height h, so that one motion suits robots of any size. Feet
follow paths relative to the base; inverse kinematics turn the paths into joint targets, for all
samples at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...base import InvalidInput, NonNegative, Number, Positive, Share, config
from ...core import Array, ContactPoint, JointTree, contact_jacobians
from .driver import Driver, DriverConfig

if TYPE_CHECKING:
    from ...core import SecondOrderSystem

_ITERATIONS = 12  # of inverse kinematics, which need 5 inside the legs' reach
_DAMPING = 1e-3  # of inverse kinematics, in leg lengths: keeps stretched legs from jumping


@config
class Walk(DriverConfig):
    """Squats, an open-loop trot and waving of one leg, over and over, under PD control.

    Torques are stiffness · (target − q) − damping · q̇, divided by the prior's gain of each motor.
    Lengths and speeds are shares of the standing height h, and of h per second.

    Attributes:
        stance: (k,) joint positions of standing [rad].
        squat: duration of the squats [s]; the base also sways and tilts.
        trot: duration of the trot [s].
        wave: duration of the waving of one leg, another one in each round [s].
        ramp: time in which each of these movements grows to its size, and fades [s].
        period: time of a step of the trot and of the next one [s].
        clearance: height to which feet are lifted [h].
        speed: largest speed of the trot [h/s].
        depth: largest vertical displacement of the base in squats [h].
        sway: largest horizontal one [h].
        tilt: largest angle of the base in squats [rad].
        reach: largest displacement of a foot that waves [h].
        lean: displacement of the base away from a foot that waves [distance to that foot].
        stiffness: of the joints, over weight · h [1/rad].
        damping: of the joints, over stiffness [s].
    """

    stance: tuple[Number, ...] = ()
    squat: NonNegative = 4.0
    trot: NonNegative = 6.0
    wave: Positive = 5.0
    ramp: Positive = 0.5
    period: Positive = 0.5
    clearance: Share = 0.18
    speed: Positive = 0.5
    depth: Share = 0.15
    sway: Share = 0.15
    tilt: Share = 0.2
    reach: Share = 0.2
    lean: NonNegative = 0.25
    stiffness: Positive = 2.0
    damping: Positive = 0.03

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the system has no feet.
        """
        raise NotImplementedError


def gait(
    walk: Walk, tree: JointTree, feet: list[ContactPoint], t: Array, rng: np.random.Generator
) -> Array:
    """(N, k) joint targets at times t (N,) of a floating tree that touches the ground with feet.

    Flat feet stay parallel to the ground on which the robot stands in `walk.stance`.
    """
    start = standing(tree, np.array(walk.stance))
    points = [point for foot in feet for point in _points_of(foot)]
    places = contact_jacobians(tree.structure, points, start)[1][0]
    each = len(points) // len(feet)
    middles = places.reshape(len(feet), each, 3).mean(axis=1)
    height = -float(middles[:, 2].mean())
    base, steps = _motion(walk, middles, height, t, rng)
    wanted = np.repeat(steps, each, axis=1) + places - base[:, None, :3]
    turned = _turned(base[:, 3:], wanted)
    return _inverse_kinematics(tree, points, turned, start, height)


def standing(tree: JointTree, joints: Array) -> Array:
    """(1, m) position of a floating tree at the origin, its joints at (k,)."""
    return tree.position(np.r_[np.zeros(6), joints])[None]


def _points_of(foot: ContactPoint) -> list[ContactPoint]:
    """A point of a round foot; three of a flat one, which fix its orientation."""
    if not foot.flat:
        return [ContactPoint(foot.body, foot.centre)]
    centre = np.asarray(foot.centre, dtype=np.float64)
    offsets = 0.1 * np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-2.0, 0.0, 0.0]])
    return [ContactPoint(foot.body, centre + offset) for offset in offsets]


def _motion(
    walk: Walk, feet: Array, height: float, t: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """(N, 6) displacement and small rotation of the base, and (N, f, 3) displacements of f feet."""
    base = np.zeros((len(t), 6))
    steps = np.zeros((len(t), len(feet), 3))
    cycle = walk.squat + walk.trot + walk.wave
    for number in range(int(np.ceil((t[-1] + 1e-9) / cycle))):
        start = number * cycle
        now = _part(t, start, walk.squat)
        base[now] += _squats(walk, height, t[now] - start, rng)
        start += walk.squat
        now = _part(t, start, walk.trot)
        steps[now] += _trot(walk, feet, height, t[now] - start, rng)
        start += walk.trot
        now = _part(t, start, walk.wave)
        foot = number % len(feet)
        moved, waved = _wave(walk, feet[foot] - feet.mean(axis=0), height, t[now] - start, rng)
        base[now] += moved
        steps[now, foot] += waved
    return base, steps


def _part(t: Array, start: float, duration: float) -> slice:
    """The samples from a start on, for a duration [s]."""
    first, last = np.searchsorted(t, [start, start + duration])
    return slice(int(first), int(last))


def _envelope(t: Array, duration: float, ramp: float, late: float = 0.0) -> Array:
    """(N,) a smooth 0 … 1 … 0 over a duration [s], which begins and ends `late` s inside it."""
    inside = np.minimum(t - late, duration - late - t) / ramp
    share = np.clip(inside, 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2)


def _sines(t: Array, count: int, low: float, high: float, rng: np.random.Generator) -> Array:
    """(N, count) sums of three sines of random frequencies [Hz] and phases, within ± 1."""
    omega = 2 * np.pi * rng.uniform(low, high, (3, count))
    phase = rng.uniform(0, 2 * np.pi, (3, count))
    return np.sin(omega * t[:, None, None] + phase).mean(axis=1)


def _squats(walk: Walk, height: float, t: Array, rng: np.random.Generator) -> Array:
    """(N, 6) of the base over its feet."""
    signals = _sines(t, 6, 0.4, 1.6, rng) * _envelope(t, walk.squat, walk.ramp)[:, None]
    place = height * np.array([walk.sway, walk.sway, walk.depth])
    return signals * np.r_[place, np.full(3, walk.tilt)]


def _trot(walk: Walk, feet: Array, height: float, t: Array, rng: np.random.Generator) -> Array:
    """(N, f, 3) of the feet: half of them swing while the others, diagonal to them, push back."""
    envelope = _envelope(t, walk.trot, walk.ramp)
    speed = walk.speed * height * _sines(t, 2, 0.1, 0.4, rng)
    turn = walk.speed * _sines(t, 1, 0.1, 0.4, rng)[:, 0]
    steps = np.zeros((len(t), len(feet), 3))
    for k, foot in enumerate(feet):
        first = (foot[0] > 0) == (foot[1] > 0)
        phase = (t / walk.period + 0.5 * first) % 1.0  # swings in the first half
        swing = np.clip(2 * phase, 0.0, 1.0)
        forward = np.where(phase < 0.5, -np.cos(np.pi * swing), 3.0 - 4.0 * phase)
        stride = 0.25 * walk.period * envelope
        steps[:, k, 0] = forward * stride * (speed[:, 0] - turn * foot[1])
        steps[:, k, 1] = forward * stride * (speed[:, 1] + turn * foot[0])
        steps[:, k, 2] = walk.clearance * height * envelope * np.sin(np.pi * swing) ** 2
    return steps


def _wave(
    walk: Walk, foot: Array, height: float, t: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """(N, 6) of the base, which leans away from the foot, and (N, 3) of the foot, in the air."""
    base = np.zeros((len(t), 6))
    base[:, :2] = -walk.lean * foot[:2] * _envelope(t, walk.wave, walk.ramp)[:, None]
    lifted = _envelope(t, walk.wave, walk.ramp, walk.ramp)
    free = _envelope(t, walk.wave, walk.ramp, 2 * walk.ramp)
    waved = walk.reach * height * _sines(t, 3, 0.5, 2.5, rng) * free[:, None]
    waved[:, 2] += 1.2 * walk.reach * height * lifted
    return base, waved


def _turned(angles: Array, places: Array) -> Array:
    """(N, k, 3) places as seen from a base that is turned by roll, pitch and yaw (N, 3)."""
    from scipy.spatial.transform import Rotation

    matrices = Rotation.from_euler("xyz", angles).as_matrix()
    return np.einsum("nji,nkj->nki", matrices, places)


def _inverse_kinematics(
    tree: JointTree, points: list[ContactPoint], wanted: Array, start: Array, height: float
) -> Array:
    """(N, k) joints that bring points to wanted places (N, p, 3) in the base's frame, or near."""
    q = np.repeat(start, len(wanted), axis=0)
    for _ in range(_ITERATIONS):
        J, places = contact_jacobians(tree.structure, points, q)
        J = J[:, :, 6:]
        missing = (wanted - places).reshape(len(q), -1, 1)
        square = np.swapaxes(J, 1, 2) @ J
        square += (_DAMPING * height) ** 2 * np.eye(square.shape[1])
        change = np.linalg.solve(square, np.swapaxes(J, 1, 2) @ missing)[:, :, 0]
        q[:, 7:] += np.clip(change, -0.3, 0.3)
        if np.abs(change).max() < 1e-8:
            break
    return q[:, 7:]
