"""Forces of a vehicle's actuators, as arrows where they act."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

from ..parameters import Array, Indices
from ..system import SecondOrderSystem
from .scene import ROBOT, base_poses
from .text import drawable

COMMANDED, ESTIMATED = f"{ROBOT}/force/commanded", f"{ROBOT}/force/estimated"
_COLORS = {COMMANDED: (226, 230, 240), ESTIMATED: (255, 138, 30)}
_RADIUS = 0.035  # of an arrow, as a share of the vehicle's size


@dataclass(frozen=True)
class Arrows:
    """The actuators of a vehicle whose forces have a place, and how they are drawn.

    Attributes:
        system: the vehicle's structure.
        columns: (j,) indices in θ of the actuators' parameters.
        mounts: (j, 3) where their forces act, in the body's axes [m].
        beside: (j, 3) from the commanded force's arrow to the estimated one's, in the body's axes
            [m]; at one place they would hide each other.
        radius: of an arrow [m].
        length: of an arrow [m/N].
    """

    system: SecondOrderSystem
    columns: Indices
    mounts: Array
    beside: Array
    radius: float
    length: float

    @staticmethod
    def of(
        system: SecondOrderSystem, size: float, q: Array, v: Array, u: Array, theta: Array
    ) -> Arrows | None:
        """Arrows of which the longest is half as long as the vehicle, in rms over given states.

        Args:
            system: any structure; it tells the places of its actuators' forces in `mounts`.
            size: half the vehicle's size [m].
            q: (k, m) positions of operation.
            v: (k, n) velocities.
            u: (k, n_u) commands.
            theta: (p,) parameters.

        Returns:
            None where no force has a place.
        """
        mounts = getattr(system, "mounts", None)
        if mounts is None or not system.group:
            return None
        seen = np.flatnonzero(np.isfinite(mounts).all(axis=1))
        if not len(seen):
            return None
        columns, mounts = system.space.actuators[seen], mounts[seen]
        forces = body_forces(system, columns, np.zeros(len(q)), q, v, u, theta)
        rms = np.sqrt(np.mean(np.linalg.norm(forces, axis=2).max(axis=1) ** 2))
        radius = _RADIUS * size
        beside = 2.4 * radius * _outward(mounts, forces)
        return Arrows(system, columns, mounts, beside, radius, size / rms if rms > 0 else 1.0)

    def log_style(self, rec: rr.RecordingStream, *paths: str) -> None:
        """Logs the colour of commanded or estimated forces, and whose they are."""
        names = [drawable(self.system.space.names[i]) for i in self.columns]
        for path in paths:
            style = rr.Arrows3D.from_fields(
                colors=[_COLORS[path]], radii=[self.radius], labels=names, show_labels=False
            )
            rec.log(path, style, static=True)

    def log(
        self, rec: rr.RecordingStream, path: str, t: Array, q: Array, v: Array, u: Array, theta: Array
    ) -> None:  # fmt: skip
        """Logs forces, all at once.

        Args:
            rec: where to.
            path: COMMANDED or ESTIMATED.
            t: (k,) times [s].
            q: (k, m) positions.
            v: (k, n) velocities.
            u: (k, n_u) commands.
            theta: (p,) or (k, p) parameters that the forces have.
        """
        forces = body_forces(self.system, self.columns, t, q, v, u, theta)
        places, attitudes = base_poses(self.system, q)
        at = self.mounts + self.beside if path == ESTIMATED else self.mounts
        origins = places[:, None] + np.einsum("kab,jb->kja", attitudes, at)
        vectors = self.length * np.einsum("kab,kjb->kja", attitudes, forces)
        arrows = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
        time = rr.TimeColumn("sim_time", duration=t)
        rec.send_columns(path, [time], arrows.partition([len(at)] * len(t)))


def body_forces(
    system: SecondOrderSystem, columns: Indices, t: Array, q: Array, v: Array, u: Array,
    theta: Array,
) -> Array:  # fmt: skip
    """(k, j, 3) forces F_k θ_k of the parameters `columns` (j,), in the body's axes [N].

    Args:
        system: a vehicle's structure, with the body's twist first among its velocities.
        columns: indices in θ.
        t: (k,) times [s].
        q: (k, m) positions.
        v: (k, n) velocities.
        u: (k, n_u) commands.
        theta: (p,) or (k, p) parameters.
    """
    linear = 3 if system.group == 6 else 2  # a planar body's forces are in its plane
    F = system.F(t, np.hstack([q, v]), u)[:, :linear, columns]
    forces = np.zeros((len(q), len(columns), 3))
    forces[..., :linear] = np.swapaxes(F, 1, 2) * theta[..., columns, None]
    return forces


def _outward(mounts: Array, forces: Array) -> Array:
    """(j, 3) unit vectors across each actuator's line of action, away from the body's origin.

    Args:
        mounts: (j, 3) [m].
        forces: (k, j, 3) [N].
    """
    chosen = []
    for mount, samples in zip(mounts, np.swapaxes(forces, 0, 1), strict=True):
        line = np.linalg.svd(samples, full_matrices=False)[2][0]
        for away in (mount, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])):
            across = away - (away @ line) * line
            if np.linalg.norm(across) > 0.1 * np.linalg.norm(away):
                break
        chosen.append(across / np.linalg.norm(across))
    return np.array(chosen)
