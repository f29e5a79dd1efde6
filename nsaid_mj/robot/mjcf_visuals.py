"""The geoms of an MJCF file, posed by Pinocchio's forward kinematics."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from ..parameters import Array
from ..structure.optional import pin
from .mjcf_tree import body_name, pose
from .shapes import DRAWN, VisualMesh, of_geom

_HIDDEN = 3  # groups of geoms from this one on are not drawn, as in MuJoCo's own viewer


class MjcfVisuals:
    """The meshes and primitive shapes of a MuJoCo model, and their poses.

    Args:
        mj: MuJoCo's model.
        tree: Pinocchio's model, which has frames of the names of MuJoCo's bodies.
    """

    def __init__(self, mj: Any, tree: pin.Model):
        self._mj, self._tree = mj, tree

    def visuals(self) -> list[VisualMesh]:
        """All meshes."""
        return list(self._meshes.values())

    @cached_property
    def _meshes(self) -> dict[int, VisualMesh]:
        """The meshes by the index of their geom."""
        mj, found = self._mj, {}
        for g in range(mj.ngeom):
            if mj.geom_bodyid[g] == 0 or mj.geom_group[g] >= _HIDDEN:
                continue
            name = f"{mj.geom(g).name or body_name(mj, mj.geom_bodyid[g])} {g}"
            kind = mujoco.mjtGeom(mj.geom_type[g])
            if kind == mujoco.mjtGeom.mjGEOM_MESH:
                found[g] = _mesh(mj, g, name)
            elif kind in DRAWN:
                found[g] = of_geom(mj, g)._replace(name=name)
        return found

    def places(self) -> list[tuple[int, pin.SE3]]:
        """The joint that moves each mesh, 0 for the base, and the mesh's pose in its axes."""
        mj, tree, found = self._mj, self._tree, []
        for g in self._meshes:
            body = body_name(mj, mj.geom_bodyid[g])
            frame = tree.frames[tree.getFrameId(body, pin.FrameType.BODY)]
            own = frame.placement * pose(mj.geom_pos[g], mj.geom_quat[g])
            found.append((int(frame.parentJoint), own))
        return found

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        Returns:
            translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        tree, places = self._tree, self.places()
        data = tree.createData()
        translations = np.zeros((len(q), len(places), 3))
        quaternions = np.zeros((len(q), len(places), 4))
        for k, configuration in enumerate(q):
            pin.forwardKinematics(tree, data, configuration)
            for j, (joint, place) in enumerate(places):
                world = data.oMi[joint] * place
                translations[k, j] = world.translation
                quaternions[k, j] = pin.Quaternion(world.rotation).coeffs()
        return translations, quaternions


def _mesh(mj: Any, geom: int, name: str) -> VisualMesh:
    """The mesh of a geom, in the geom's own frame."""
    m = mj.geom_dataid[geom]
    vertex, face = mj.mesh_vertadr[m], mj.mesh_faceadr[m]
    material = mj.geom_matid[geom]
    color = mj.mat_rgba[material] if material >= 0 else mj.geom_rgba[geom]
    red, green, blue, alpha = color.tolist()
    return VisualMesh(
        name,
        mj.mesh_vert[vertex : vertex + mj.mesh_vertnum[m]].astype(float),
        mj.mesh_face[face : face + mj.mesh_facenum[m]].copy(),
        (red, green, blue, alpha),
    )
