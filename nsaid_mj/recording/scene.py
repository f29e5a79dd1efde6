"""The robot in 3D: its meshes where it has any, else the skeleton of its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import rerun as rr

from ..parameters import Array
from ..plants import Plant
from ..systems.multibody import Multibody

ROBOT = "robot"
_FAR = 4.0  # a robot that reaches so many times its own size travels
_CREASE = np.cos(np.radians(35))  # faces that meet at more than this angle keep their edge
_JOINT, _BONE, _STAND = (255, 176, 59), (130, 170, 255), (70, 78, 92)


@dataclass(frozen=True)
class Camera:
    """Where a 3D view is seen from.

    Attributes:
        position: (3,) of the eye [m].
        target: (3,) what it looks at [m].
        size: radius of what there is to see [m].
        ground: height of the ground grid [m].
        follows: the entity that the eye goes along with, "" where it stands still.
    """

    position: Array
    target: Array
    size: float
    ground: float
    follows: str = ""


class Scene:
    """Draws a plant into a recording. It reads no true value: shapes and poses only.

    Args:
        plant: what is drawn.
    """

    def __init__(self, plant: Plant):
        self._plant, self._meshes = plant, plant.visuals()
        self._paths = [f"{ROBOT}/{i:02}_{_plain(m.name)}" for i, m in enumerate(self._meshes)]
        model = plant.system.model if isinstance(plant.system, Multibody) else None
        self._skeleton = model if not self._meshes else None

    @property
    def empty(self) -> bool:
        """Whether there is nothing to draw."""
        return not self._meshes and self._skeleton is None

    def log_shapes(self, rec: rr.RecordingStream, camera: Camera | None) -> None:
        """Logs what does not move: axes, meshes, a stand from the ground to an arm's foot."""
        rec.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for path, mesh in zip(self._paths, self._meshes, strict=True):
            vertices, triangles, normals = shaded(mesh.vertices, mesh.triangles)
            rec.log(
                path,
                rr.Mesh3D(
                    vertex_positions=vertices,
                    triangle_indices=triangles,
                    vertex_normals=normals,
                    albedo_factor=[round(255 * c) for c in mesh.color],
                ),
                static=True,
            )
        if camera is None:
            return
        if self._skeleton is not None:
            width = 0.015 * camera.size
            links = rr.LineStrips3D.from_fields(colors=[_BONE], radii=[width])
            joints = rr.Points3D.from_fields(colors=[_JOINT], radii=[2.5 * width])
            rec.log(f"{ROBOT}/links", links, static=True)
            rec.log(f"{ROBOT}/joints", joints, static=True)
        if camera.ground < 0 and isinstance(self._plant.system, Multibody):
            stand = rr.Cylinders3D(  # an arm that reaches below its foot stands on something
                lengths=[-camera.ground],
                radii=[0.045 * camera.size],
                centers=[[0.0, 0.0, camera.ground / 2]],
                colors=[_STAND],
                fill_mode="solid",
            )
            rec.log(f"{ROBOT}/stand", stand, static=True)

    def log_poses(self, rec: rr.RecordingStream, t: Array, q: Array) -> None:
        """Logs the poses at times t (k,) [s] and positions q (k, m), all at once."""
        time = rr.TimeColumn("sim_time", duration=t)
        if self._skeleton is not None:
            bones = self._bones(q)
            count = bones.shape[1]
            strips = rr.LineStrips3D.columns(strips=list(bones.reshape(-1, 2, 3)))
            rec.send_columns(f"{ROBOT}/links", [time], strips.partition([count] * len(t)))
            joints = rr.Points3D.columns(positions=bones[:, :, 0].reshape(-1, 3))
            rec.send_columns(f"{ROBOT}/joints", [time], joints.partition([count] * len(t)))
            return
        translations, quaternions = self._plant.poses(q)
        for i, path in enumerate(self._paths):
            pose = rr.Transform3D.columns(
                translation=translations[:, i], quaternion=quaternions[:, i]
            )
            rec.send_columns(path, [time], pose)

    def camera(self, q: Array) -> Camera:
        """A view of all that the positions q (k, m) reach, or of a vehicle that goes far."""
        points, first = self._reach(q), self._reach(q[:1])
        follows = ""
        if self._paths and np.ptp(points, axis=0).max() > _FAR * np.ptp(first, axis=0).max():
            points, follows = first, self._paths[0]
        low, high = points.min(axis=0), points.max(axis=0)
        target, size = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.05)
        ground = min(0.0, float(low[2])) if low[2] < 0.2 * size else 0.0
        eye = np.array([1.15, -1.45, 0.65])
        away = (2.6 if follows else 1.6) * size  # an arm never fills all of its reach at once
        return Camera(target + away * eye / np.linalg.norm(eye), target, size, ground, follows)

    def _reach(self, q: Array) -> Array:
        """(…, 3) corners of the meshes' boxes, or the joints, at positions q (k, m)."""
        if self._skeleton is not None:
            return self._bones(q).reshape(-1, 3)
        translations, quaternions = self._plant.poses(q)
        points = []
        for i, mesh in enumerate(self._meshes):
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T
            turned = _rotate(quaternions[:, i], corners)
            points.append((turned + translations[:, i, None]).reshape(-1, 3))
        return np.concatenate(points) if points else np.zeros((1, 3))

    def _bones(self, q: Array) -> Array:
        """(k, bones, 2, 3) segments from every joint to the frames that hang on it [m]."""
        model = self._skeleton
        assert model is not None
        data = model.createData()
        frames = [f for f in model.frames if not np.allclose(f.placement.translation, 0)]
        bones = []
        for configuration in q:
            pin.forwardKinematics(model, data, configuration)
            origin = [data.oMi[i].translation.copy() for i in range(model.njoints)]
            segments = [(origin[i], origin[model.parents[i]]) for i in range(1, model.njoints)]
            segments += [
                (data.oMi[f.parentJoint].act(f.placement).translation, origin[f.parentJoint])
                for f in frames
            ]
            bones.append(segments)
        return np.array(bones)


def shaded(vertices: Array, triangles: np.ndarray) -> tuple[Array, np.ndarray, Array]:
    """Splits a mesh at its sharp edges, so that round parts shine and edges stay edges.

    Args:
        vertices: (k, 3) [m].
        triangles: (f, 3) indices.

    Returns:
        (3 f, 3) vertices, (f, 3) triangles and (3 f, 3) unit normals.
    """
    corners = vertices[triangles]  # (f, 3 corners, 3)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(area, axis=1, keepdims=True)
    unit = area / np.where(length > 0, length, np.inf)
    # Vertices that lie at one place are one point, whatever the file's indices say.
    _, point = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    at = point.ravel()[triangles]
    normals = np.repeat(unit[:, None], 3, axis=1)
    order = np.argsort(at, axis=None, kind="stable")
    bounds = np.flatnonzero(np.diff(at.ravel()[order])) + 1
    for group in np.split(order, bounds):
        face = group // 3
        near = unit[face] @ unit[face].T > _CREASE
        normals.reshape(-1, 3)[group] = near @ area[face]
    norm = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = np.where(norm > 0, normals / np.where(norm > 0, norm, 1), [0.0, 0.0, 1.0])
    count = np.arange(3 * len(triangles), dtype=np.uint32)
    return corners.reshape(-1, 3), count.reshape(-1, 3), normals.reshape(-1, 3)


def _rotate(quaternions: Array, points: Array) -> Array:
    """(k, j, 3) points (j, 3) turned by quaternions (k, 4) in x, y, z, w."""
    axis, w = quaternions[:, None, :3], quaternions[:, None, 3:]
    cross = np.cross(axis, points[None])
    return points + 2 * (w * cross + np.cross(axis, cross))


def _plain(name: str) -> str:
    """A name that needs no escape in an entity path."""
    return "".join(c if c.isalnum() else "_" for c in name)
