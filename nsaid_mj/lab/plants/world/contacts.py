"""Contacts of a robot with itself and with the ground, by MuJoCo's collision detection.

Every link is the convex hull of its visual mesh. Joined links do not count, nor do pairs that touch
in most poses, for which the hulls are too coarse. The ground is the plane z = 0; it does not count
for bodies mounted on it.
"""

from collections import Counter
from threading import Lock
from typing import Any

import mujoco
import numpy as np

from ....core import Array
from ....robots import RobotModel, tree_spec, wxyz

_POSES = 50  # random poses, and largest share of them in which a counted pair touches
_MOST = 0.8


class Contacts:
    """Collision detection for a robot on a fixed base, within ranges (n,), (n,) of coordinates."""

    def __init__(self, robot: RobotModel, limits: tuple[Array, Array]):
        spec = tree_spec(robot.model, 1e-3)
        spec.option.disableflags = 0
        bodies = [spec.worldbody, *(spec.body(name) for name in list(robot.model.names)[1:])]
        self.known = False  # whether the robot has any mesh; without, contacts are unknown
        for number, (mesh, joint, place) in enumerate(robot.visuals.parts):
            self.known = True
            name = f"hull {number}"
            spec.add_mesh(
                name=name,
                uservert=mesh.vertices.ravel().tolist(),
                userface=mesh.triangles.ravel().tolist(),
            )
            geom = bodies[joint].add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
            geom.pos = place.translation
            geom.quat = wxyz(place.rotation)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10, 10, 0.1])
        self._model: Any = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._names = [self._model.body(i).name for i in range(self._model.nbody)]
        model = self._model
        self._addresses = [
            int(model.jnt_qposadr[model.joint(name).id]) for name in list(robot.model.names)[1:]
        ]
        parents = model.body_parentid
        self._joined = {(int(parents[b]), b) for b in range(1, model.nbody)}
        self._lock = Lock()
        poses = np.random.default_rng(0).uniform(*limits, (_POSES, len(limits[0])))
        often = Counter(pair for pose in poses for pair in self._pairs(pose))
        self._joined |= {pair for pair, count in often.items() if count > _MOST * _POSES}

    def _pairs(self, coordinates: Array) -> list[tuple[int, int]]:
        """Pairs of bodies (low, high) that touch in a pose (n,), joined ones excepted."""
        body = self._model.geom_bodyid
        with self._lock:  # only one thread at a time may use MuJoCo's data
            self._data.qpos[self._addresses] = coordinates
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
            ends = [(int(body[c.geom1]), int(body[c.geom2])) for c in self._data.contact]
        return sorted({(min(pair), max(pair)) for pair in ends if pair[0] != pair[1]})

    def touching(self, coordinates: Array) -> list[str]:
        """Names the parts that touch in each pose of (N, n); "" where none do."""
        found = []
        for row in coordinates:
            pairs = [pair for pair in self._pairs(row) if pair not in self._joined]
            found.append(" and ".join(self._name(b) for b in pairs[0]) if pairs else "")
        return found

    def _name(self, body: int) -> str:
        return self._names[body] if body else "the base or the ground"
