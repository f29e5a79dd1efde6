"""Triangle meshes of MuJoCo's primitive shapes, for visualisation."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from ..parameters import Array

_CORNERS = np.array(np.meshgrid(*[[-1, 1]] * 3, indexing="ij")).reshape(3, 8).T.astype(float)
_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                   [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])  # fmt: skip
_SIDES = 24


DRAWN = frozenset(
    {
        mujoco.mjtGeom.mjGEOM_BOX,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        mujoco.mjtGeom.mjGEOM_SPHERE,
    }
)
"""The geom types that `of_geom` supports."""


class VisualMesh(NamedTuple):
    """A triangle mesh fixed to a body.

    Attributes:
        name: unique among a plant's meshes.
        vertices: (k, 3) in the mesh's own frame [m].
        triangles: (f, 3) indices into `vertices`.
        color: (4,) RGBA in 0 … 1.
    """

    name: str
    vertices: Array
    triangles: np.ndarray
    color: tuple[float, float, float, float]


def of_geom(model: Any, i: int) -> VisualMesh:
    """The mesh of a MuJoCo geom, in the geom's own frame.

    Args:
        model: MuJoCo's model.
        i: index of a box, cylinder, capsule, ellipsoid or sphere.
    """
    size, kind = model.geom_size[i].copy(), model.geom_type[i]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        vertices, triangles = _CORNERS * size, _FACES
    else:
        radius, height = _profile(kind, size)
        vertices, triangles = _turned(radius, height)
        if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            vertices = vertices * size
    red, green, blue, alpha = model.geom_rgba[i].tolist()
    return VisualMesh(
        model.geom(i).name or f"geom {i}", vertices, triangles, (red, green, blue, alpha)
    )


def _profile(kind: int, size: Array) -> tuple[Array, Array]:
    """(k,) radii and (k,) heights [m] along the axis of a solid of revolution.

    Args:
        kind: geom type: cylinder, capsule, ellipsoid (as a unit sphere) or sphere.
        size: (3,) MuJoCo's `geom_size`.
    """
    arc = np.linspace(0, np.pi, 13)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return size[0] * np.array([0.0, 1, 1, 0]), size[1] * np.array([-1.0, -1, 1, 1])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return size[0] * np.sin(arc), -size[0] * np.cos(arc) + size[1] * np.sign(arc - np.pi / 2)
    r = 1.0 if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0]
    return r * np.sin(arc), -r * np.cos(arc)


def _turned(radius: Array, height: Array) -> tuple[Array, np.ndarray]:
    """Vertices and triangles of a solid of revolution about z; radius and height are (k,) [m]."""
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)], axis=1)
    vertices = np.concatenate([r * ring + [0, 0, h] for r, h in zip(radius, height, strict=True)])
    k = np.arange(_SIDES)
    following = (k + 1) % _SIDES
    triangles = [
        part
        for level in range(len(radius) - 1)
        for a, b in [(level * _SIDES, (level + 1) * _SIDES)]
        for part in (np.c_[a + k, a + following, b + k], np.c_[a + following, b + following, b + k])
    ]
    return vertices, np.concatenate(triangles)
