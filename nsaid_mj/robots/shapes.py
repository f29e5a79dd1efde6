"""Triangle meshes of robots: the files of a URDF's meshes, and poses."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from urllib.parse import unquote

import mujoco
import numpy as np
from lxml.etree import _Element as Element

from ..base import Finding, pin
from ..core import Array
from .tree import pose

_CORNERS = np.array(np.meshgrid(*[[-1, 1]] * 3, indexing="ij")).reshape(3, 8).T.astype(float)
_FACES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)
_SIDES = 24
_DRAWN = tuple(
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"))
    for kind in ("BOX", "CYLINDER", "CAPSULE", "ELLIPSOID", "SPHERE")
)
_HIDDEN = 3  # groups of geoms from this one on are hidden, as in MuJoCo's own viewer


class VisualMesh(NamedTuple):
    """A triangle mesh fixed to a body."""

    name: str  # unique among a plant's meshes
    vertices: Array  # (k, 3) in the mesh's own frame [m]
    triangles: np.ndarray  # (f, 3) indices into `vertices`
    color: tuple[float, ...]  # (4,) RGBA in 0 … 1

    @classmethod
    def of_geom(cls, model: Any, i: int) -> VisualMesh:
        """The mesh of MuJoCo's geom i, a box or a solid of revolution, in the geom's own frame."""
        size = model.geom_size[i].copy()
        kind = model.geom_type[i]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            vertices = _CORNERS * size
            triangles = _FACES
        else:
            radius, height = _profile(kind, size)
            vertices, triangles = _turned(radius, height)
            if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
                vertices = vertices * size
        name = model.geom(i).name or f"geom {i}"
        color = tuple(model.geom_rgba[i].tolist())
        return cls(name, vertices, triangles, color)

    @staticmethod
    def is_drawn(kind: int) -> bool:
        """Whether `of_geom` supports geoms of a type, one of MuJoCo's `mjtGeom`."""
        return kind in _DRAWN


class Shape(NamedTuple):
    """A mesh on a tree: Pinocchio's index of its joint, 0 for the base, and its pose there."""

    mesh: VisualMesh
    joint: int
    place: Any


class Shapes:
    """The meshes of a tree of joints, made on first access; there may be none."""

    def __init__(self, tree: pin.Model, made: Callable[[], Iterable[Shape]]):
        self._tree = tree
        self._made = made

    @cached_property
    def parts(self) -> list[Shape]:
        """All meshes with the joints that move them."""
        return list(self._made())

    def visuals(self) -> list[VisualMesh]:
        """All meshes."""
        return [part.mesh for part in self.parts]

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        They are translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        data = self._tree.createData()
        translations = np.zeros((len(q), len(self.parts), 3))
        quaternions = np.zeros((len(q), len(self.parts), 4))
        for k, configuration in enumerate(q):
            pin.forwardKinematics(self._tree, data, configuration)
            for i, (_, joint, place) in enumerate(self.parts):
                world = data.oMi[joint] * place
                translations[k, i] = world.translation
                quaternions[k, i] = pin.Quaternion(world.rotation).coeffs()
        return translations, quaternions


def shapes_of_geometry(visual: pin.GeometryModel) -> Iterable[Shape]:
    """The triangle meshes of Pinocchio's geometry; other shapes are left out."""
    for geometry in visual.geometryObjects:
        shape = geometry.geometry
        if hasattr(shape, "vertices") and hasattr(shape, "num_tris"):
            faces = [shape.tri_indices(i) for i in range(shape.num_tris)]
            triangles = np.array([(t[0], t[1], t[2]) for t in faces])
            color = tuple(np.asarray(geometry.meshColor, dtype=float).ravel().tolist())
            mesh = VisualMesh(geometry.name, np.array(shape.vertices()), triangles, color)
            yield Shape(mesh, int(geometry.parentJoint), geometry.placement)


def shapes_of_geoms(mj: Any, tree: pin.Model) -> Iterable[Shape]:
    """The meshes and primitive shapes of a MuJoCo model.

    The tree has a frame or else a joint for every body, by its name.
    """
    for g in range(mj.ngeom):
        body = mj.geom_bodyid[g]
        mesh = mj.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
        if (
            not body
            or mj.geom_group[g] >= _HIDDEN
            or not (mesh or VisualMesh.is_drawn(mj.geom_type[g]))
        ):
            continue
        name = mj.body(body).name or f"body {body}"
        joint = 0
        place = pin.SE3.Identity()
        if tree.existBodyName(name):
            frame = tree.frames[tree.getFrameId(name, pin.FrameType.BODY)]
            joint = int(frame.parentJoint)
            place = frame.placement
        else:
            joint = int(tree.getJointId(name))
        own = place * pose(mj.geom_pos[g], mj.geom_quat[g])
        drawn = _mesh(mj, g) if mesh else VisualMesh.of_geom(mj, g)
        name = mj.geom(g).name or f"{name} {g}"
        yield Shape(drawn._replace(name=name), joint, own)


def _mesh(mj: Any, geom: int) -> VisualMesh:
    """The mesh of a geom, in the geom's own frame."""
    m = mj.geom_dataid[geom]
    vertex = mj.mesh_vertadr[m]
    face = mj.mesh_faceadr[m]
    material = mj.geom_matid[geom]
    color = mj.mat_rgba[material] if material >= 0 else mj.geom_rgba[geom]
    return VisualMesh(
        mj.geom(geom).name,
        mj.mesh_vert[vertex : vertex + mj.mesh_vertnum[m]].astype(float),
        mj.mesh_face[face : face + mj.mesh_facenum[m]].copy(),
        tuple(color.tolist()),
    )


def _profile(kind: int, size: Array) -> tuple[Array, Array]:
    """(k,) radii and (k,) heights [m] along the axis of a solid of revolution.

    An ellipsoid is a unit sphere; `size` (3,) is MuJoCo's `geom_size`.
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


def resolve_meshes(root: Element, path: Path) -> list[Finding]:
    """Makes the paths of a URDF's visual meshes absolute, in place; removes those not found.

    `package://` names are sought in every ancestor folder of the file, in `ROS_PACKAGE_PATH` and in
    `AMENT_PREFIX_PATH`; relative names in every ancestor folder. Collision shapes are removed.
    Returns one note on all meshes that were not found, if there are any.
    """
    missing = []
    for link in root.iter("link"):
        for collision in link.findall("collision"):
            link.remove(collision)
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            found = next((p for p in _candidates(name, path) if os.path.isfile(p)), None)
            if found is None:
                missing.append(name)
                link.remove(visual)
            else:
                mesh.set("filename", str(found))
    remark = "these links are not drawn; the dynamics do not need them"
    remedy = "Set ROS_PACKAGE_PATH to the folder that contains the package, to see them."
    return Finding.missing_files(path, "mesh", missing, remark, remedy)


def _candidates(name: str, path: Path) -> Iterator[Path]:
    """Possible places of a mesh, the likeliest first."""
    scheme, _, rest = name.rpartition("://")
    rest = unquote(rest) if scheme else rest
    if scheme == "file" or (not scheme and Path(rest).is_absolute()):
        yield Path(rest)
        return
    folders = list(path.resolve().parents)
    if scheme in {"package", "model"}:
        package, _, inside = rest.partition("/")
        for folder in [*folders, *_ros_folders()]:
            yield folder / package / inside
            if folder.name == package:
                yield folder / inside
        rest = inside
    for folder in folders:
        yield folder / rest


def _ros_folders() -> Iterator[Path]:
    """Folders in which ROS 1 and ROS 2 look for packages."""
    for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for entry in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(entry) / inside


class Looks(Protocol):
    """Meshes of a robot and their poses."""

    def visuals(self) -> list[VisualMesh]:
        """All meshes; there may be none."""
        ...

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        They are translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        ...
