"""Joint targets of a robot that squats, trots and waves its legs.

Feet follow paths relative to the base; inverse kinematics turn the paths into joint targets, for
all samples of a round at once. A `walk` has the fields of `walking.Walk`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...base import InvalidInput
from ...core import (
    GRAVITY,
    Array,
    ContactPoint,
    JointTree,
    SecondOrderSystem,
)
from .driver import Driver

_TABLE = 0.01  # interval of the tables of targets, which are interpolated [s]
_ITERATIONS = 12  # of inverse kinematics, which need 5 inside the legs' reach
_DAMPING = 1e-3  # of inverse kinematics, in leg lengths: keeps stretched legs from jumping


def on_feet(system: SecondOrderSystem) -> JointTree:
    """The system, if it is a floating tree of joints with feet.

    Raises:
        InvalidInput: it is not.
    """
    if not isinstance(system, JointTree) or not system.group or not system.structure.contacts:
        expected = "a robot that stands on feet"
        raise InvalidInput("excitation", expected, type(system).__name__, "Use WalkingPlant.")
    return system


class Gait:
    """Joint targets of a floating tree that touches the ground with the contacts of its structure.

    Flat feet stay parallel to the ground on which the robot stands in the stance.

    Attributes:
        stance: (k,) joints of standing [rad].
        height: of the base over the ground in the stance [m].
    """

    def __init__(self, walk: Any, tree: JointTree, seed: int):
        joints = tree.n - tree.group
        if not walk.stance or joints % len(walk.stance):
            expected = f"positions of all {joints} joints, or of those of one leg"
            raise InvalidInput("excitation.stance", expected, len(walk.stance), "One for each.")
        self.stance = np.resize(np.array(walk.stance), joints)
        self._walk = walk
        self._tree = tree
        self._seed = seed
        feet = tree.structure.contacts
        self._points = [point for foot in feet for point in _points_of(foot)]
        self._start = tree.position(np.r_[np.zeros(tree.group), self.stance])[None]
        self._places = tree.contact_jacobians(self._points, self._start)[1][0]
        self._feet = self._places.reshape(len(feet), -1, 3).mean(axis=1)
        self.height = -float(tree.contact_jacobians(feet, self._start)[1][0, :, 2].min())
        self._rounds: dict[int, Array] = {}

    def __call__(self, t: ArrayLike) -> Array:
        """(..., k) joint targets at times t (...) [s]."""
        times = np.asarray(t, dtype=np.float64)
        cycle = self._walk.cycle
        number = np.floor(times / cycle).astype(np.intp)
        found = np.empty((*times.shape, len(self.stance)))
        for each in np.unique(number).tolist():
            now = number == each
            place = (times[now] - each * cycle) / _TABLE
            row = place.astype(np.intp)
            part = (place - row)[:, None]
            table = self._round(each)
            found[now] = (1 - part) * table[row] + part * table[row + 1]
        return found

    def _round(self, number: int) -> Array:
        """(N, k) joint targets of a round, at intervals of `_TABLE`."""
        if number not in self._rounds:
            rows = int(np.ceil(self._walk.cycle / _TABLE)) + 2
            t = _TABLE * np.arange(rows, dtype=np.float64)
            rng = np.random.default_rng([self._seed, number])
            base, steps = _motion(self._walk, self._feet, self.height, number, t, rng)
            each = len(self._points) // len(self._feet)
            wanted = np.repeat(steps, each, axis=1) + self._places - base[:, None, :3]
            turned = _turned(base[:, 3:], wanted)
            self._rounds[number] = _inverse_kinematics(
                self._tree, self._points, turned, self._start, self.height
            )
        return self._rounds[number]


class WalkingDriver(Driver):
    """PD control of the joints about their targets, with the prior's masses and gains."""

    def __init__(self, walk: Any, tree: JointTree, prior: Array, seed: int):
        self._gait = Gait(walk, tree, seed)
        mass = sum(float(prior[i.start]) for i in tree.structure.inertias)
        self._kp = walk.stiffness * GRAVITY * mass * self._gait.height
        self._kv = walk.damping * self._kp
        self._gains = prior[tree.space.actuators]
        self._n = tree.n
        self._base = tree.group

    def start(self) -> tuple[Array, Array]:
        """The stance, at rest on level ground."""
        place = np.zeros(self._base)
        place[2] = self._gait.height
        return np.r_[place, self._gait.stance], np.zeros(self._n)

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(k,) commands of the joints' motors."""
        joints = len(self._gait.stance)
        torque = self._kp * (self._gait(t) - q[-joints:]) - self._kv * v[-joints:]
        return np.asarray(torque / self._gains)


def _points_of(foot: ContactPoint) -> list[ContactPoint]:
    """A point of a round foot; three of a flat one, which fix its orientation."""
    if not foot.flat:
        return [ContactPoint(foot.body, foot.centre)]
    centre = np.asarray(foot.centre, dtype=np.float64)
    offsets = 0.1 * np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-2.0, 0.0, 0.0]])
    return [ContactPoint(foot.body, centre + offset) for offset in offsets]


def _motion(
    walk: Any, feet: Array, height: float, number: int, t: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """(N, 6) displacement and small rotation of the base, and (N, f, 3) displacements of f feet.

    `number` is that of the round, at times t (N,) since whose start [s].
    """
    base = np.zeros((len(t), 6))
    steps = np.zeros((len(t), len(feet), 3))
    now = _part(t, 0.0, walk.squat)
    base[now] = _squats(walk, height, t[now], rng)
    now = _part(t, walk.squat, walk.trot)
    steps[now] = _trot(walk, feet, height, t[now] - walk.squat, rng)
    start = walk.squat + walk.trot
    now = _part(t, start, walk.wave)
    foot = number % len(feet)
    moved, waved = _wave(walk, feet[foot] - feet.mean(axis=0), height, t[now] - start, rng)
    base[now] = moved
    steps[now, foot] = waved
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


def _squats(walk: Any, height: float, t: Array, rng: np.random.Generator) -> Array:
    """(N, 6) of the base over its feet."""
    signals = _sines(t, 6, 0.4, 1.6, rng) * _envelope(t, walk.squat, walk.ramp)[:, None]
    place = height * np.array([walk.sway, walk.sway, walk.depth])
    return signals * np.r_[place, np.full(3, walk.tilt)]


def _trot(walk: Any, feet: Array, height: float, t: Array, rng: np.random.Generator) -> Array:
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
    walk: Any, foot: Array, height: float, t: Array, rng: np.random.Generator
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
        J, places = tree.contact_jacobians(points, q)
        J = J[:, :, 6:]
        missing = (wanted - places).reshape(len(q), -1, 1)
        square = np.swapaxes(J, 1, 2) @ J
        square += (_DAMPING * height) ** 2 * np.eye(square.shape[1])
        change = np.linalg.solve(square, np.swapaxes(J, 1, 2) @ missing)[:, :, 0]
        q[:, 7:] += np.clip(change, -0.3, 0.3)
        if np.abs(change).max() < 1e-8:
            break
    return q[:, 7:]
