"""A robot of exact structure in MuJoCo: a true θ, and a callback for all other forces."""

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from ....core import Array, JointTree, SecondOrderSystem
from ....robots import Looks, VisualMesh
from .coordinates import JointMap
from .forces import ColumnForces, column_forces
from .mismatch import Mismatch
from .plant import Plant


class GeomLooks:
    """The geoms of a MuJoCo model, without the ground, posed by its kinematics.

    `place` writes a position q (m,) of the system into MuJoCo's data.
    """

    def __init__(self, model: Any, place: Callable[[Any, Array], None]):
        plane = mujoco.mjtGeom.mjGEOM_PLANE
        self._model, self._place, self._data = model, place, mujoco.MjData(model)
        self._drawn = [i for i in range(model.ngeom) if model.geom_type[i] != plane]

    def visuals(self) -> list[VisualMesh]:
        """All geoms as meshes."""
        return [VisualMesh.of_geom(self._model, i) for i in self._drawn]

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the geoms at positions q (k, m); see `Looks`."""
        places = np.empty((len(q), len(self._drawn), 3))
        turns = np.empty((len(q), len(self._drawn), 4))
        bodies = self._model.geom_bodyid[self._drawn]
        for k, row in enumerate(q):
            self._place(self._data, row)
            mujoco.mj_kinematics(self._model, self._data)
            places[k] = self._data.geom_xpos[self._drawn]
            turns[k] = self._data.xquat[bodies]
        return places, _turned_by(turns, self._model.geom_quat[self._drawn])


def _turned_by(bodies: Array, geoms: Array) -> Array:
    """Products (x, y, z, w) of MuJoCo's quaternions (…, 4) (w, x, y, z): scipy's import is slow."""
    w = bodies[..., :1]
    v = bodies[..., 1:]
    real = w * geoms[..., :1] - np.sum(v * geoms[..., 1:], axis=-1, keepdims=True)
    vector = w * geoms[..., 1:] + geoms[..., :1] * v + np.cross(v, geoms[..., 1:])
    return np.concatenate([vector, real], axis=-1)


class SimulatedRobot(Plant):
    """A robot of exact structure in MuJoCo.

    Args:
        system: the structure that an identifier may know.
        truth: (p,) the true θ.
        acting: (p,) θ of the forces beyond MuJoCo's; see `Forces`.
        spec: MuJoCo's specification, with the true inertias, and an actuator for every command.
        names: names of its joints in the system's order; see `JointMap`.
        mismatch: the effects outside the structure.
        looks: the meshes that show it; None for the specification's geoms.

    Raises:
        ValueError: MuJoCo rejects the specification.
        InvalidInput: the mismatch does not suit the time step.
    """

    system: SecondOrderSystem

    def __init__(
        self,
        system: SecondOrderSystem,
        truth: Array,
        acting: Array,
        spec: Any,
        names: Sequence[str],
        mismatch: Mismatch,
        looks: Looks | None = None,
    ):
        self.system = system
        self._truth = truth
        forces = ColumnForces(system, acting, np.array(mismatch.flow))
        self.passive = column_forces()
        self.gain_places = forces.gain_places
        spec.nuserdata = forces.size
        self._compile(spec, mismatch)
        tree = system.joints if isinstance(system, JointTree) else []
        circular = [joint.nq == 2 for joint in tree]
        self.joints = JointMap(self.model, names, circular, planar=system.group == 3)
        self.reading = self.joints.reading
        self._numbers = forces.numbers(self.reading, mismatch.lag > 0)
        self._looks = GeomLooks(self.model, self.joints.place) if looks is None else looks
        self.reset(np.zeros(system.n), np.zeros(system.n))

    @property
    def truth(self) -> Array:
        """(p,) the true θ."""
        return self._truth

    def _place(self, position: Array, velocity: Array) -> None:
        self.joints.write(self.data, position, velocity)
        self.data.userdata[:] = self._numbers

    def coordinates(self) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities."""
        return self.joints.read(self.data)
