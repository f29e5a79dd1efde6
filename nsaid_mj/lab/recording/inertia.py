"""Centres of mass and inertia ellipsoids of the links in 3D: estimated and true, or nominal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

from ...base import pin
from ...core import Array, JointTree, ParameterSpace, SecondOrderSystem
from ...report import Scene

LINKS = f"{Scene.ROBOT}/links_of_theta"
ESTIMATED_INERTIA = "estimated"
REFERENCE = "reference"
_COLOURS = {ESTIMATED_INERTIA: (255, 138, 30), REFERENCE: (226, 230, 240)}
_LARGEST = 0.2  # half axis of an ellipsoid, over the robot's size; larger ones are drawn smaller


@dataclass(frozen=True)
class Inertias:
    """The links whose ten inertial parameters are in θ, and the entities that show them."""

    places: list[slice]  # slice of θ of each link
    homes: list[str]  # entity of each link's frame
    system: SecondOrderSystem  # the structure

    @staticmethod
    def of(system: SecondOrderSystem) -> Inertias | None:
        """The links of a structure; None if it has none of this form, as in water."""
        places = inertial(system.space)
        if isinstance(system, JointTree):
            if len(places) != system.bodies:
                return None
            return Inertias(places, [f"{LINKS}/{k}" for k in range(len(places))], system)
        if len(places) == 1 and len(system.body_axes) == 3:
            return Inertias(places, [Scene.BODY], system)
        return None

    def log_frames(self, rec: rr.RecordingStream, t: Array, q: Array) -> None:
        """Logs the links' frames at times t (k,) and positions q (k, m)."""
        if not isinstance(self.system, JointTree):
            return  # the vehicle's own pose is logged there
        time = rr.TimeColumn("sim_time", duration=t)
        for home, (places, attitudes) in zip(self.homes, frames(self.system, q), strict=True):
            pose = rr.Transform3D.columns(translation=places, quaternion=attitudes)
            rec.send_columns(home, [time], pose)

    def log(self, rec: rr.RecordingStream, kind: str, t: Array, theta: Array, size: float) -> None:
        """Logs centres and ellipsoids of θ (k, p) at times t (k,); one row makes them static."""
        time = [rr.TimeColumn("sim_time", duration=t)] if len(t) > 1 else []
        colour = _COLOURS[kind]
        for place, home in zip(self.places, self.homes, strict=True):
            centres, halves, turns = ellipsoids(theta[:, place])
            halves *= np.minimum(1, _LARGEST * size / np.maximum(halves.max(axis=1), 1e-9))[:, None]
            path = f"{home}/inertia/{kind}"
            shape = rr.Ellipsoids3D.from_fields(
                colors=[colour], fill_mode="majorwireframe", line_radii=[0.003 * size]
            )
            rec.log(path, shape, static=True)
            columns = rr.Ellipsoids3D.columns(centers=centres, half_sizes=halves, quaternions=turns)
            rec.send_columns(path, time, columns)
            mark = rr.Points3D.from_fields(colors=[colour], radii=[0.012 * size])
            rec.log(f"{home}/centre_of_mass/{kind}", mark, static=True)
            points = rr.Points3D.columns(positions=centres)
            rec.send_columns(f"{home}/centre_of_mass/{kind}", time, points)


def inertial(space: ParameterSpace) -> list[slice]:
    """The slices of θ that are the ten inertial parameters of a link."""
    return [place for block, place in space if block.geometry == "pseudo_inertia"]


def frames(system: JointTree, q: Array) -> list[tuple[Array, Array]]:
    """(k, 3) positions [m] and (k, 4) quaternions of every link's joint frame at q (k, m)."""
    data = system.model.createData()
    poses = np.empty((system.bodies, len(q), 7))
    for row, position in enumerate(q):
        pin.forwardKinematics(system.model, data, position)
        for j in range(system.bodies):
            poses[j, row] = pin.SE3ToXYZQUAT(data.oMi[j + 1])
    return [(pose[:, :3], pose[:, 3:]) for pose in poses]


def ellipsoids(phi: Array) -> tuple[Array, Array, Array]:
    """Uniform ellipsoids with the given inertial parameters.

    phi (k, 10) is m, m·c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the frame's origin. Returns (k, 3)
    centres [m], (k, 3) half axes [m] and (k, 4) quaternions (x, y, z, w).
    """
    mass = phi[:, 0]
    safe = np.where(mass > 0, mass, np.inf)[:, None]
    centres = phi[:, 1:4] / safe
    inertia = phi[:, [4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(-1, 3, 3)
    second = 0.5 * np.trace(inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - inertia
    second -= mass[:, None, None] * np.einsum("ki,kj->kij", centres, centres)
    values, axes = np.linalg.eigh(second)  # of ∫ r rᵀ dm about the centre of mass
    axes[..., 2] *= np.sign(np.linalg.det(axes))[:, None]
    turns = np.array([pin.Quaternion(np.ascontiguousarray(R)).coeffs() for R in axes])
    return centres, np.sqrt(5 * np.maximum(values, 0.0) / safe), turns
