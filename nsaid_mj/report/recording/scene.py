"""The robot in 3D: its meshes, or a skeleton of its joints, and the path of a vehicle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core import Array, JointTree, SecondOrderSystem
from ...robots import Looks

ROBOT = "robot"
BODY = f"{ROBOT}/body"
PATH = f"{ROBOT}/path"
TRAIL = f"{ROBOT}/trail"
CENTRE = f"{BODY}/centre"
MARK = f"{BODY}/mark"
_TRAIL = 12.0  # length of the bright part of a vehicle's path, over half its size
_SHORTEST = 1.0  # bounds on the duration of the bright part [s]
_LONGEST = 20.0
EYE = np.array([1.15, -1.45, 0.65]) / np.linalg.norm([1.15, -1.45, 0.65])
_SURVEY = 4.4  # distance of the camera on a path, over half its size: its view is narrow
_CREASE = np.cos(np.radians(35))  # edges between faces at a larger angle are drawn sharp
_JOINT = (255, 176, 59)
_BONE = (130, 170, 255)
_STAND = (70, 78, 92)
_WAY = (58, 104, 128)
_LAST_WAY = (64, 214, 224)
_GHOST = 0.6  # opacity, and share of white, of meshes with arrows inside
_LIGHT = 0.25
_WHITE = (255, 255, 255)


@dataclass(frozen=True)
class Camera:
    """The camera of a 3D view, in world coordinates."""

    position: Array  # (3,) position of the eye [m]
    target: Array  # (3,) point that it looks at [m]
    size: float  # radius of the visible scene [m]
    ground: float  # height of the ground grid [m]
    grid: float  # spacing of the ground grid [m]
    follows: str = ""  # entity that the camera tracks; empty if it is fixed
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)  # (3,) tracked point, in the body frame [m]
    trail: float = 0.0  # duration of the bright part of a vehicle's path [s]

    def view(self, name: str) -> rrb.Spatial3DView:
        """The robot above the ground grid; the most recent part of a vehicle's path is bright."""
        since = rr.TimeRangeBoundary.cursor_relative(seconds=-self.trail)
        return self._space(
            name,
            [f"/{ROBOT}/**", f"-/{MARK}"],
            {
                PATH: _period(rr.TimeRangeBoundary.infinite(), since),
                TRAIL: _period(since, rr.TimeRangeBoundary.cursor_relative()),
            },
        )

    def way(self) -> rrb.Spatial3DView:
        """A vehicle's path so far, and a mark at its position."""
        so_far = _period(rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.cursor_relative())
        thin = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(1.5))
        mark = rr.Points3D.from_fields(radii=rr.Radius.ui_points(5.0), colors=[_WHITE])
        return self._space(
            f"Path, grid of {self.grid:g} m",
            [f"/{TRAIL}", f"/{MARK}"],
            {TRAIL: [so_far, thin], MARK: [mark]},
        )

    def _space(
        self, name: str, contents: Sequence[str], overrides: dict[str, Any]
    ) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(
            origin="/",
            contents=list(contents),
            name=name,
            background=rrb.Background(color=(27, 32, 41)),
            line_grid=rrb.LineGrid3D(
                visible=True,
                spacing=self.grid,
                plane=rr.components.Plane3D.XY.with_distance(self.ground),
                stroke_width=1.0,
                color=(90, 100, 120, 120),
            ),
            eye_controls=rrb.EyeControls3D(
                kind=rrb.Eye3DKind.Orbital,
                position=self.position,
                look_target=self.target,
                tracking_entity=self.follows or None,
            ),
            overrides={f"/{entity}": override for entity, override in overrides.items()},
        )


def _period(start: rr.TimeRangeBoundary, end: rr.TimeRangeBoundary) -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(timeline="sim_time", start=start, end=end)


class Scene:
    """Draws a robot into a recording, from shapes and poses only; it reads no true value.

    Args:
        system: the robot's structure; the skeleton of its joints is drawn if it has no meshes.
        looks: its meshes and their poses; None if there are none.

    Attributes:
        ROBOT: entity below which everything is drawn.
        BODY: entity whose frame is that of a vehicle's body.
        vehicle: whether the robot has a free body: in space, in the plane, or along the vertical.
    """

    ROBOT = ROBOT
    BODY = BODY

    def __init__(self, system: SecondOrderSystem, looks: Looks | None):
        self._system = system
        self._looks = looks
        self._meshes = looks.visuals() if looks is not None else []
        self._rigid = (
            system.forward is not None and len(system.structure.bodies) == 1
        )  # all meshes on one body
        home = BODY if self._rigid else ROBOT
        plain = ["".join(c if c.isalnum() else "_" for c in mesh.name) for mesh in self._meshes]
        self._paths = [f"{home}/{i:02}_{name}" for i, name in enumerate(plain)]
        tree = system if isinstance(system, JointTree) else None
        self._skeleton = tree if not self._meshes else None
        self.vehicle = len(system.body_axes) > 0
        self._place = np.zeros((0, 3))  # (1, 3) a vehicle's last logged position, once there is one

    @property
    def empty(self) -> bool:
        """Whether there is nothing to draw."""
        return not self._meshes and self._skeleton is None

    def paths_of(self, links: Sequence[str]) -> list[str]:
        """The entities of the meshes that belong to some links, by the meshes' names."""
        named = zip(self._paths, self._meshes, strict=True)
        return [path for path, mesh in named if any(mesh.name.startswith(k) for k in links)]

    def log_shapes(
        self,
        rec: rr.RecordingStream,
        camera: Camera | None,
        ghost: bool = False,
        changing: Mapping[str, float] | None = None,
    ) -> None:
        """Logs everything static: axes, meshes, and a stand below an arm that is above the ground.

        Args:
            rec: recording stream.
            camera: camera of the view; None if there is no 3D view.
            ghost: draws the meshes half transparent, to show arrows inside them.
            changing: entities of meshes whose colour changes later, and the recording's first time
                [s]: a static colour would hide later ones.
        """
        rec.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for path, mesh in zip(self._paths, self._meshes, strict=True):
            vertices, triangles, normals = shaded(mesh.vertices, mesh.triangles)
            color = np.array(mesh.color)
            if ghost:
                color = np.append(color[:3] + _LIGHT * (1 - color[:3]), _GHOST * color[3])
            shape = rr.Mesh3D(
                vertex_positions=vertices, triangle_indices=triangles, vertex_normals=normals
            )
            rec.log(path, shape, static=True)
            albedo = rr.Mesh3D.from_fields(albedo_factor=[round(255 * c) for c in color])
            if path in (changing or {}):
                rec.set_time("sim_time", duration=(changing or {})[path])
                rec.log(path, albedo)
                rec.reset_time()
            else:
                rec.log(path, albedo, static=True)
        if camera is None:
            return
        if self._rigid:
            self._log_meshes(rec, [], self._system.position(np.zeros((1, self._system.n))))
        if self._skeleton is not None:
            width = 0.015 * camera.size
            links = rr.LineStrips3D.from_fields(colors=[_BONE], radii=[width])
            joints = rr.Points3D.from_fields(colors=[_JOINT], radii=[2.5 * width])
            rec.log(f"{ROBOT}/links", links, static=True)
            rec.log(f"{ROBOT}/joints", joints, static=True)
        if self.vehicle:
            for path, color, width in ((PATH, _WAY, 1.0), (TRAIL, _LAST_WAY, 1.8)):
                radius = rr.Radius.ui_points(width)
                way = rr.LineStrips3D.from_fields(colors=[color], radii=radius)
                rec.log(path, way, static=True)
            centre = rr.Points3D([camera.centre], colors=[_LAST_WAY], radii=[0.01 * camera.size])
            rec.log(CENTRE, centre, static=True)  # the camera can track drawn entities only
            rec.log(MARK, rr.Points3D([[0.0, 0.0, 0.0]]), static=True)
        elif camera.ground < 0 and isinstance(self._system, JointTree):
            stand = rr.Cylinders3D(  # supports an arm that reaches below its base
                lengths=[-camera.ground],
                radii=[0.045 * camera.size],
                centers=[[0.0, 0.0, camera.ground / 2]],
                colors=[_STAND],
                fill_mode="solid",
            )
            rec.log(f"{ROBOT}/stand", stand, static=True)

    def log_poses(self, rec: rr.RecordingStream, t: Array, q: Array) -> None:
        """Logs the poses at times t (k,) [s] and positions q (k, m) in one batch.

        A vehicle's path continues from its last logged position.
        """
        time = rr.TimeColumn("sim_time", duration=t)
        if self.vehicle:
            self._log_body(rec, t, q)
        if self._skeleton is not None:
            bones = self._bones(q)
            count = bones.shape[1]
            strips = rr.LineStrips3D.columns(strips=list(bones.reshape(-1, 2, 3)))
            rec.send_columns(f"{ROBOT}/links", [time], strips.partition([count] * len(t)))
            joints = rr.Points3D.columns(positions=bones[:, :, 0].reshape(-1, 3))
            rec.send_columns(f"{ROBOT}/joints", [time], joints.partition([count] * len(t)))
            return
        if not self._rigid:
            self._log_meshes(rec, [time], q)

    def _log_meshes(self, rec: rr.RecordingStream, time: list[rr.TimeColumn], q: Array) -> None:
        """Logs the meshes' poses at positions q (k, m); static if there is no time column."""
        translations, quaternions = self._poses(q)
        for i, path in enumerate(self._paths):
            pose = rr.Transform3D.columns(
                translation=translations[:, i], quaternion=quaternions[:, i]
            )
            rec.send_columns(path, time, pose)

    def _log_body(self, rec: rr.RecordingStream, t: Array, q: Array) -> None:
        """Logs a vehicle's pose, and its path as one line segment per frame."""
        places, quaternions = base_poses(self._system, q)
        pose = rr.Transform3D.columns(translation=places, quaternion=quaternions)
        rec.send_columns(BODY, [rr.TimeColumn("sim_time", duration=t)], pose)
        stops = np.vstack([self._place, places])
        self._place = places[-1:]
        steps = np.stack([stops[:-1], stops[1:]], axis=1)
        if len(steps):
            time = rr.TimeColumn("sim_time", duration=t[-len(steps) :])
            strips = rr.LineStrips3D.columns(strips=list(steps)).partition([1] * len(steps))
            for path in (PATH, TRAIL):
                rec.send_columns(path, [time], strips)

    def camera(self, q: Array, v: Array) -> Camera:
        """A fixed camera on an arm's whole workspace, or one that tracks a vehicle.

        q (k, m) are positions, the first at the start of the run, v (k, n) velocities.
        """
        points = self._reach(q)
        first = self._reach(q[:1])
        lowest = float(points[:, 2].min())
        if self.vehicle:
            points = first
        target, size = _ball(points)
        if not self.vehicle:
            away = 1.6 * size
            ground = min(0.0, lowest) if lowest < 0.2 * size else 0.0
            return Camera(target + away * EYE, target, size, ground, rounded(size / 5))
        places, attitudes = base_poses(self._system, q[:1])
        back = attitudes * [-1, -1, -1, 1]
        centre = tuple(rotated(back, target - places)[0, 0].tolist())
        linear = v[:, : len(self._system.body_axes)]
        speed = float(np.sqrt(np.mean(np.sum(linear**2, axis=1))))
        trail = float(np.clip(_TRAIL * size / max(speed, 1e-9), _SHORTEST, _LONGEST))
        grid = rounded(max(2 * size, (target[2] - lowest) / 5))
        return Camera(target + 2.7 * size * EYE, target, size, lowest, grid, CENTRE, centre, trail)

    def survey(self, q: Array) -> Camera:
        """A fixed camera on a vehicle's whole path over positions q (k, m)."""
        places = base_poses(self._system, q)[0]
        target, size = _ball(places)
        ground = float(places[:, 2].min())
        return Camera(target + _SURVEY * size * EYE, target, size, ground, rounded(size / 3))

    def _reach(self, q: Array) -> Array:
        """(j, 3) corners of the meshes' bounding boxes, or joints, at positions q (k, m) [m]."""
        if self._skeleton is not None:
            return self._bones(q).reshape(-1, 3)
        translations, quaternions = self._poses(q)
        points = []
        for i, mesh in enumerate(self._meshes):
            low = mesh.vertices.min(axis=0)
            high = mesh.vertices.max(axis=0)
            corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T
            turned = rotated(quaternions[:, i], corners)
            points.append((turned + translations[:, i, None]).reshape(-1, 3))
        return np.concatenate(points) if points else np.zeros((1, 3))

    def _poses(self, q: Array) -> tuple[Array, Array]:
        """Translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) at positions q (k, m)."""
        if self._looks is None:
            return np.zeros((len(q), 0, 3)), np.zeros((len(q), 0, 4))
        return self._looks.poses(q)

    def _bones(self, q: Array) -> Array:
        """(k, bones, 2, 3) segments between joints, and from joints to their frames [m]."""
        assert self._skeleton is not None
        return self._skeleton.bones(q)


def _ball(points: Array) -> tuple[Array, float]:
    """(3,) centre and radius of a ball around the bounding box of points (k, 3) [m]."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.05)


def shaded(vertices: Array, triangles: np.ndarray) -> tuple[Array, np.ndarray, Array]:
    """Splits a mesh into separate triangles with normals smoothed across all but sharp edges.

    vertices (k, 3) are in m, triangles (f, 3) indices. Returns (3f, 3) vertices [m], (f, 3)
    triangles and (3f, 3) unit normals.
    """
    corners = vertices[triangles]  # (f, 3 corners, 3)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(area, axis=1, keepdims=True)
    unit = area / np.where(length > 0, length, np.inf)
    # Vertices at the same position are merged, even if the mesh file lists them separately.
    _, point = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    at = point.ravel()[triangles].ravel()
    order = np.argsort(at, kind="stable")
    normals = np.empty((len(at), 3))
    _, first, met = np.unique(at[order], return_index=True, return_counts=True)
    for count in np.unique(met):  # vectorised over all points shared by `count` corners
        group = order[first[met == count, None] + np.arange(count)]
        face = group // 3
        near = unit[face] @ unit[face].swapaxes(1, 2) > _CREASE
        normals[group] = near @ area[face]
    norm = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(norm > 0, normals / np.where(norm > 0, norm, 1), [0.0, 0.0, 1.0])
    numbers = np.arange(3 * len(triangles), dtype=np.uint32)
    return corners.reshape(-1, 3), numbers.reshape(-1, 3), normals


def base_poses(system: SecondOrderSystem, q: Array) -> tuple[Array, Array]:
    """(k, 3) positions [m] and (k, 4) quaternions (x, y, z, w) of a vehicle's body at q (k, m)."""
    if system.group == 6:
        return q[:, :3], q[:, 3:7]
    zero = np.zeros(len(q))
    if system.group == 0:
        return np.c_[zero, zero, q[:, 0]], np.tile([0.0, 0.0, 0.0, 1.0], (len(q), 1))
    half = q[:, 2] / 2
    return np.c_[q[:, :2], zero], np.c_[zero, zero, np.sin(half), np.cos(half)]


def rounded(length: float) -> float:
    """The closest of 1, 2, 5 · 10ⁿ to a length [m], on a logarithmic scale."""
    n = 10.0 ** np.floor(np.log10(length))
    return min((n, 2 * n, 5 * n, 10 * n), key=lambda step: abs(np.log(step / length)))


def rotated(quaternions: Array, points: Array) -> Array:
    """(k, j, 3) points (j, 3) or (k, j, 3) rotated by quaternions (k, 4) in x, y, z, w order."""
    axis = quaternions[:, None, :3]
    w = quaternions[:, None, 3:]
    cross = np.cross(axis, points)
    return points + 2 * (w * cross + np.cross(axis, cross))
