"""Actuator forces of a vehicle, drawn as arrows at their points of application."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ..log import Log
from ..parameters import Array, Indices, phrase
from ..structure.system import SecondOrderSystem
from .scene import BODY, body_axes
from .text import drawable

COMMANDED, ESTIMATED = f"{BODY}/force/commanded", f"{BODY}/force/estimated"
FAILED = (224, 49, 49)
"""Colour of failed actuators and links."""
_COLORS = {COMMANDED: (226, 230, 240), ESTIMATED: (255, 138, 30)}
_STEEP = 0.5  # cosine of the angle to the inward normal within which a force points inwards
_MUCH = 5.0  # ratio of force magnitudes from which the smaller force's arrow is magnified
_LENGTH, _RADIUS = 0.8, 0.035  # of the longest arrow, over half the vehicle's size


@dataclass(frozen=True)
class Arrows:
    """Arrows of a vehicle's actuators whose forces have a point of application."""

    system: SecondOrderSystem  # the vehicle's structure
    # for each arrow, the indices in θ of the parameters whose forces add up to it, such as a fin's
    # lift and drag
    parts: Sequence[Indices]
    mounts: Array  # (j, 3) points of application, in the body frame [m]
    # (j, 3) from the commanded force's arrow to the estimated one's, in the body frame [m], so that
    # neither hides the other
    offsets: Array
    radius: float  # radius of an arrow [m]
    lengths: Array  # (j, 1) scale of each arrow [m/N]
    # magnification of the arrows of some kinds of actuators, by name of the kind
    magnified: Mapping[str, float]

    @staticmethod
    def of(system: SecondOrderSystem, size: float, rows: Log, theta: Array) -> Arrows | None:
        """Scales the arrows so that the rms length of the longest is 0.8 `size`.

        The arrows of a kind of actuator with much smaller forces are magnified, within that length.
        `size` is half the vehicle's size [m], `rows` are samples of the motion and theta (p,) the
        parameters for which forces are evaluated. None if no force has a point of application.
        """
        given = system.mounts
        if given is None or not body_axes(system):
            return None
        at: dict[tuple[float, ...], list[int]] = {}
        for k, mount in zip(system.space.actuators, given, strict=True):
            if np.isfinite(mount).all():
                at.setdefault(tuple(mount), []).append(k)
        if not at:
            return None
        parts, mounts = [np.array(k) for k in at.values()], np.array(list(at))
        forces = body_forces(system, parts, rows, theta)
        kinds = [next(b.name for b, s in system.space if s.start <= k[0] < s.stop) for k in parts]
        longest = {kind: _rms([kind == other for other in kinds], forces) for kind in kinds}
        most = max(longest.values())
        times = {kind: _magnified(most / own) if own else 1.0 for kind, own in longest.items()}
        radius = _RADIUS * size
        if system.group == 3:
            mounts[:, 2] += 2.5 * radius  # above the ground and the path
        return Arrows(
            system,
            parts,
            mounts,
            offsets=2.4 * radius * _outward(mounts, forces),
            radius=radius,
            lengths=_LENGTH * size / (most or 1.0) * np.array([[times[kind]] for kind in kinds]),
            magnified={kind: factor for kind, factor in times.items() if factor > 1},
        )

    def log_style(self, rec: rr.RecordingStream, *paths: str) -> None:
        """Logs the colours of commanded or estimated forces, and the labels of their actuators."""
        space = self.system.space
        labels = [drawable(phrase(space.labels[i] for i in part)) for part in self.parts]
        for path in paths:
            style = rr.Arrows3D.from_fields(
                colors=[_COLORS[path]],
                radii=[self.radius],
                labels=labels,
                show_labels=False,
            )
            rec.log(path, style, static=True)

    def log(
        self,
        rec: rr.RecordingStream,
        path: str,
        rows: Log,
        theta: Array,
        failed: NDArray[np.bool_] | None = None,
    ) -> None:
        """Logs forces in one batch. Arrows start at their mount, or end there if they push inwards.

        `path` is COMMANDED or ESTIMATED, theta (p,) or (k, p) for k samples; `failed` (k, p) marks
        parameters that a fault has changed, whose arrows are red.
        """
        forces = body_forces(self.system, self.parts, rows, theta)
        vectors = self.lengths * forces
        at = self.mounts + self.offsets if path == ESTIMATED else self.mounts
        origins = np.where(_pushes(self.mounts, forces)[..., None], at - vectors, at)
        arrows = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
        time = rr.TimeColumn("sim_time", duration=rows.t)
        counts = [len(self.parts)] * len(rows.t)
        rec.send_columns(path, [time], arrows.partition(counts))
        if failed is not None and failed.any():
            red = np.stack([failed[:, part].any(axis=1) for part in self.parts], axis=1)
            colors = np.where(red[..., None], FAILED, _COLORS[path]).reshape(-1, 3)
            painted = rr.Arrows3D.columns(colors=colors.astype(np.uint8))
            rec.send_columns(path, [time], painted.partition(counts))


def body_forces(
    system: SecondOrderSystem, parts: Sequence[Indices], rows: Log, theta: Array
) -> Array:
    """(k, j, 3) forces F_i θ_i, summed over the parameters of each part, in the body frame [N].

    The first velocities of the vehicle's structure are the body's twist; `parts` are j groups of
    indices in θ, theta (p,) or (k, p) for k samples.
    """
    axes = body_axes(system)  # a planar body's forces are in its plane
    F = system.F(rows.t, np.hstack([rows.q, rows.v]), rows.u)[:, : len(axes)]
    forces = np.zeros((len(rows.t), len(parts), 3))
    for j, part in enumerate(parts):
        forces[:, j, axes] = (F[..., part] * theta[..., None, part]).sum(axis=-1)
    return forces


def _rms(chosen: list[bool], forces: Array) -> float:
    """Rms over k rows of the largest of the chosen forces, out of (k, j, 3) [N]."""
    longest = np.linalg.norm(forces[:, chosen], axis=2).max(axis=1)
    return float(np.sqrt(np.mean(longest**2)))


def _magnified(ratio: float) -> float:
    """The largest of 5, 10, 20, 50, 100 … that does not exceed a ratio; 1 if the ratio is < 5."""
    if ratio < _MUCH:
        return 1.0
    n = 10.0 ** np.floor(np.log10(ratio))
    return float(max(n * step for step in (1, 2, 5) if n * step <= ratio))


def _pushes(mounts: Array, forces: Array) -> NDArray[np.bool_]:
    """(k, j) whether forces (k, j, 3) at mounts (j, 3) point roughly towards the origin."""
    sizes = np.linalg.norm(forces, axis=2) * np.linalg.norm(mounts, axis=1)
    return np.einsum("kja,ja->kj", forces, mounts) < -_STEEP * sizes


def _outward(mounts: Array, forces: Array) -> Array:
    """(j, 3) unit vectors normal to each actuator's line of action, away from the body's origin.

    mounts (j, 3) are in m, forces (k, j, 3) in N.
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
