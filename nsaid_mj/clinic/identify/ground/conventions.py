"""Whether a walking log means what its columns are taken for: the order of joints, signs, the IMU.

The balance of the whole robot without the forces on its feet (`core`'s `Elimination`) holds for the
right columns alone. With the links of the file and the gains, none negative, that fit best, its
error is some per cent, since masses and friction of a file are not exact. With legs swapped, joints
in another order, reversed commands or an IMU turned by a right angle it is several times as large.
Each hypothesis changes the motion, and the one with the least error is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from ....base import Finding, pin
from ....core import Array, Elimination
from ....robots import RobotModel
from ...logs.imu import GRAVITY
from ...logs.recordings import Recordings
from ...logs.remedies import remedy_of
from ..links import file_links
from ..rows import unrolled, with_columns
from ..smoothing import Filter
from .feet import feet_of, imu_pose
from .rows import Ground, smooth_ground

_CUTOFF = 5.0  # of the compared motion [Hz]: the weight's share, and not that of touch-downs
_RATE = 50.0  # at which samples are picked, at least [Hz]
_SAMPLES = 400  # compared, of all logs
_BETTER = 0.6  # error over that of the log as it is, below which a hypothesis is believed
_LEAST = 0.05  # error of a log as it is, below which nothing is wrong with it
_MOST_LIMBS = 4  # whose orders are all tried; of more limbs those of pairs
_MISTAKES = 3  # found one after the other


class _Motion(NamedTuple):
    """Samples of a base and of joints."""

    q: Array  # (N, 7 + k)
    v: Array  # (N, 6 + k)
    a: Array  # (N, 6 + k)
    u: Array  # (N, k) commands, in the direction of the joints

    def ordered(self, q: Sequence[int], u: Sequence[int]) -> _Motion:
        """With columns (k,) of the joints' motion, and (k,) of the commands, in other orders."""
        joints = list(q)
        parts = [
            np.hstack([x[:, :first], x[:, first:][:, joints]])
            for x, first in ((self.q, 7), (self.v, 6), (self.a, 6))
        ]
        return _Motion(*parts, self.u[:, list(u)])

    def turned(self, turn: Array) -> _Motion:
        """With an IMU whose axes are turned against the base by a rotation (3, 3)."""
        spin = self.q.copy()
        spin[:, 3:7] = (Rotation.from_quat(self.q[:, 3:7]) * Rotation.from_matrix(turn.T)).as_quat()
        moved = []
        for x in (self.v, self.a):
            base = [x[:, :3] @ turn.T, x[:, 3:6] @ turn.T]
            moved.append(np.hstack([*base, x[:, 6:]]))
        return _Motion(spin, *moved, self.u)


class Convention(NamedTuple):
    """A hypothesis about a log."""

    code: str  # of the finding
    text: str
    changes: dict[str, object]  # values of map.toml that mend it, by table and key
    motion: _Motion  # as it would have been


class GroundBalance:
    """The error of the whole robot's balance along samples of a log."""

    def __init__(self, robot: RobotModel, recordings: Recordings):
        """Of a robot whose base floats."""
        assert recordings.imu is not None
        self.robot = robot
        self.driven = recordings.driven(robot)
        self.recordings = recordings
        self.feet = feet_of(robot, recordings.contacts)[0]
        self.place = imu_pose(robot, recordings.imu)[0]
        own = file_links(robot.model)
        self._system = with_columns(unrolled(robot.system), [], [], len(own))
        self._links = own
        weight = GRAVITY * float(own[::10].sum())
        centres = [np.linalg.norm(foot.centre) for foot in self.feet]
        reach = float(np.median(centres))
        self._size = weight * np.repeat([1.0, reach], 3)
        self.measured = recordings.imu.accelerometer is not None

    def motion(self) -> _Motion:
        """Smoothed samples of the log as it is."""
        recordings = self.recordings
        every = max(1, int(recordings.rate / _RATE))
        chosen = Filter(_CUTOFF / 5.0, recordings.rate, every)
        ground = Ground(self.feet, self.place)
        parts = []
        for segment in recordings.segments:
            if len(segment.log.t) < 8 * every:
                continue
            own = smooth_ground(ground, segment, chosen)
            u = chosen.low_pass(segment.log.u)[::every] * np.sign(self.robot.gain)
            parts.append((own.q, own.v, own.a, u))
        whole = [np.concatenate(part) for part in zip(*parts, strict=True)]
        pick = np.unique(np.linspace(0, len(whole[0]) - 1, _SAMPLES).astype(int))
        return _Motion(*(x[pick] for x in whole))

    def error(self, motion: _Motion) -> float:
        """Of the forces and torques on the base, over those of the links."""
        force, acting = self._rows(motion)
        return float(scipy.optimize.nnls(acting, force)[1] / np.linalg.norm(force))

    def signs(self, motion: _Motion) -> Array:
        """(k,) −1 of commands that the balance needs reversed, else 1."""
        force, acting = self._rows(motion)
        spread = 1e-2 * np.sqrt(np.mean(acting**2)) * np.sqrt(len(force))
        ridge = np.vstack([acting, spread * np.eye(acting.shape[1])])
        found = np.linalg.lstsq(ridge, np.append(force, np.zeros(acting.shape[1])), rcond=None)[0]
        signs = np.ones(len(self.robot.joints))
        signs[self.driven] = np.where(found < 0, -1.0, 1.0)
        return signs

    def _rows(self, motion: _Motion) -> tuple[Array, Array]:
        """(6 N,) the links' wrench without contact forces, and (6 N, k) that of unit gains."""
        structure = self._system.structure
        E = Elimination(structure, self.feet, motion.q).E[:, :6]
        force = self._system.torques(self._links, *motion[:3])
        own = np.einsum("nij,nj->ni", E, force) / self._size
        columns = [6 + j for j in self.driven]
        acting = E[:, :, columns] * motion.u[:, None, self.driven] / self._size[:, None]
        return own.ravel(), acting.reshape(-1, len(columns))


def convention_findings(robot: RobotModel, recordings: Recordings) -> list[Finding]:
    """Refusals of a log whose columns mean something else; `robot` has a base that floats."""
    balance = GroundBalance(robot, recordings)
    motion = balance.motion()
    error = balance.error(motion)
    found: list[Convention] = []
    errors = [error]
    for _ in range(_MISTAKES):
        if errors[-1] < _LEAST:
            break
        judged = [(balance.error(one.motion), one) for one in _hypotheses(balance, motion)]
        least, best = min(judged, key=lambda one: one[0])
        if not least < _BETTER * errors[-1]:
            break
        found.append(best)
        errors.append(least)
        motion = best.motion
    if not found:
        return []
    changes: dict[str, object] = {}
    for one in found:
        changes |= one.changes
    text = "; ".join(one.text for one in found)
    text += " (the balance of the whole robot, without the forces on its feet, then has an error "
    text += f"of {100 * errors[-1]:.2g} %, as the log is {100 * error:.2g} %)"
    data = {"map": changes, "error": error, "mended": errors[-1]}
    return [Finding("refusal", found[0].code, "", text, remedy_of(changes), data)]


def _hypotheses(balance: GroundBalance, motion: _Motion) -> Iterator[Convention]:
    robot = balance.robot
    names = robot.joints
    own = list(range(len(names)))
    for order, words in orders(robot):
        swaps = {names[j]: names[k] for j, k in enumerate(order) if j != k}
        if not swaps:
            continue
        columns = [names[j] for j in np.argsort(order)]
        changes: dict[str, object] = {"order.joints": columns}
        text = f"the joints' columns are in another order than taken: {words}"
        yield Convention("joint_order", text, changes, motion.ordered(order, order))
        text = f"the commands are in another order than the positions: {words}"
        only: dict[str, object] = {"order.command": swaps}
        yield Convention("swapped", text, only, motion.ordered(own, order))
    signs = balance.signs(motion)
    if (signs < 0).any():
        reversed_ = [name for name, sign in zip(names, signs, strict=True) if sign < 0]
        every = len(reversed_) == len(balance.driven)
        who = "all joints" if every else ", ".join(reversed_)
        value: object = -1 if every else dict.fromkeys(reversed_, -1)
        text = f"the commands of {who} count against the model"
        moved = motion._replace(u=motion.u * signs)
        yield Convention("reversed_sign", text, {"factors.command": value}, moved)
    yield from _mounts(balance, motion)


def orders(robot: RobotModel) -> Iterator[tuple[list[int], str]]:
    """Likely orders of a file's columns: (k,) the column of each joint, and words.

    Limb after limb, or first the first joint of every limb, with the limbs in any order.
    """
    limbs = limbs_of(robot)
    own = sorted(range(len(limbs)), key=lambda limb: limbs[limb][0])
    if len(limbs) <= _MOST_LIMBS:
        sequences = [list(one) for one in permutations(own)]
    else:
        sequences = [own, own[::-1]]
        for a in range(len(own)):
            for b in range(a):
                pair = list(own)
                pair[a], pair[b] = pair[b], pair[a]
                sequences.append(pair)
    names = robot.joints
    for sequence in sequences:
        deep = max(len(limb) for limb in limbs)
        by_limb = [joint for k in sequence for joint in limbs[k]]
        by_depth = [limbs[k][d] for d in range(deep) for k in sequence if d < len(limbs[k])]
        for columns in (by_limb, by_depth):
            order = np.argsort(columns).tolist()
            if len(columns) == len(names):
                first = ", ".join(names[joint] for joint in columns[: len(limbs[0]) + 1])
                yield order, f"{first}, …"


def limbs_of(robot: RobotModel) -> list[list[int]]:
    """The joints of each limb: numbers of those that a joint on the base carries, from 0."""
    model = robot.model
    joints = {model.getJointId(name): k for k, name in enumerate(robot.joints)}
    found: dict[int, list[int]] = {}
    for number, k in joints.items():
        root = number
        while int(model.parents[root]) in joints:
            root = int(model.parents[root])
        found.setdefault(root, []).append(k)
    return [sorted(limb) for limb in found.values()]


def _mounts(balance: GroundBalance, motion: _Motion) -> Iterator[Convention]:
    """An IMU whose axes are turned against those that the model file says, by right angles."""
    own = balance.place.rotation
    for axes in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), axes] = signs
            if np.linalg.det(turn) < 0 or np.trace(turn) == 3:
                continue
            angles = np.degrees(pin.rpy.matrixToRpy(turn @ own)).round(1) + 0.0
            place = balance.place.translation.round(6) + 0.0
            text = "the IMU's axes are turned against the base's, by "
            text += f"{', '.join(f'{x:g}' for x in angles)}° (roll, pitch, yaw)"
            changes: dict[str, object] = {
                "base.place": place.tolist(),
                "base.turn": angles.tolist(),
            }
            imu = balance.recordings.imu
            assert imu is not None
            stated = {f"base.{key}": list(getattr(imu, key)) for key in ("orientation", "gyro")}
            if imu.accelerometer is not None:
                stated["base.accelerometer"] = list(imu.accelerometer)
            yield Convention("imu_mount", text, stated | changes, motion.turned(turn))
