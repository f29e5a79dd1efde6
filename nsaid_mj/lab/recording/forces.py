"""Actuator forces of a vehicle, drawn as arrows at their points of application."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ...core import Array, Indices, Log, SecondOrderSystem, phrase
from ...report import Scene, drawable

COMMANDED = f"{Scene.BODY}/force/commanded"
ESTIMATED = f"{Scene.BODY}/force/estimated"
FAILED = (224, 49, 49)
"""Colour of failed actuators and links."""
_COLORS = {COMMANDED: (226, 230, 240), ESTIMATED: (255, 138, 30)}
_STEEP = 0.5  # cosine of the angle to the inward normal within which a force points inwards
_MUCH = 5.0  # ratio of force magnitudes from which the smaller force's arrow is magnified
_LENGTH = 0.8  # of the longest arrow, over half the vehicle's size
_RADIUS = 0.035


def drawing_words(drawn: str, magnified: Mapping[str, float] | None = None) -> str:
    """Title of the robot's view: what is drawn, and which arrows are magnified."""
    longer = [f"{kind} magnified {times:g} ×" for kind, times in (magnified or {}).items()]
    return drawable("; ".join([drawn or "Robot, simulated by MuJoCo", *longer]))


def mounts_of(system: SecondOrderSystem) -> dict[tuple[float, ...], list[int]]:
    """The indices in θ of a vehicle's forces with a point of application, by that point [m].

    Points are in the body frame; the forces at one add up, such as a fin's lift and drag.
    """
    at: dict[tuple[float, ...], list[int]] = {}
    if system.mounts is not None and system.body_axes:
        for k, mount in zip(system.space.actuators, system.mounts, strict=True):
            if np.isfinite(mount).all():
                at.setdefault(tuple(mount), []).append(k)
    return at


class Arrows:
    """Arrows of a vehicle's actuators; at least one must have a point of application.

    The rms length of the longest is 0.8 `size`. Those of a kind of actuator with much smaller
    forces are magnified, within that length.

    Args:
        system: the vehicle's structure; see `mounts_of`.
        size: half the vehicle's size [m].
        rows: samples of the motion.
        theta: (p,) parameters for which forces are evaluated.

    Attributes:
        parts: for each of j arrows, the indices in θ of the parameters whose forces add up to it.
        radius: radius of an arrow [m].
        offsets: (j, 3) from the commanded force's arrow to the estimated one's, in the body frame
            [m], so that neither hides the other.
        lengths: (j, 1) scale of each arrow [m/N].
        magnified: magnification of the arrows of some kinds of actuators, by name of the kind.
    """

    kind = "forces"
    paths = (COMMANDED, ESTIMATED)
    rate = 30.0  # arrows that are drawn per second, and at most
    frames = 12000

    def __init__(self, system: SecondOrderSystem, size: float, rows: Log, theta: Array):
        self._system, at = system, mounts_of(system)
        self.parts, mounts = [np.array(k) for k in at.values()], np.array(list(at))
        forces = body_forces(system, self.parts, rows, theta)
        names = [(block.name, place) for block, place in system.space]
        kinds = [next(n for n, s in names if s.start <= k[0] < s.stop) for k in self.parts]
        sizes = np.linalg.norm(forces, axis=2)
        longest = dict[str, float]()
        for kind in kinds:  # the rms over the rows of the largest force
            largest = sizes[:, [kind == other for other in kinds]].max(axis=1)
            longest[kind] = float(np.sqrt(np.mean(largest**2)))
        most = max(longest.values())
        times = {kind: _magnified(most / own) if own else 1.0 for kind, own in longest.items()}
        self.magnified = {kind: factor for kind, factor in times.items() if factor > 1}
        self.lengths = _LENGTH * size / (most or 1.0) * np.array([[times[k]] for k in kinds])
        self.radius = _RADIUS * size
        if system.group == 3:
            mounts[:, 2] += 2.5 * self.radius  # above the ground and the path
        self.offsets = 2.4 * self.radius * _outward(mounts, forces)
        self._mounts = {COMMANDED: mounts, ESTIMATED: mounts + self.offsets}

    def log_style(self, rec: rr.RecordingStream, *paths: str) -> None:
        """Logs the colours of commanded or estimated forces, and the labels of their actuators."""
        space = self._system.space
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
        forces = body_forces(self._system, self.parts, rows, theta)
        vectors = self.lengths * forces
        at = self._mounts[path]
        pushes = _pushes(self._mounts[COMMANDED], forces)
        origins = np.where(pushes[..., None], at - vectors, at)
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
    axes = system.body_axes  # a planar body's forces are in its plane
    F = system.F(rows.t, np.hstack([rows.q, rows.v]), rows.u)[:, : len(axes)]
    forces = np.zeros((len(rows.t), len(parts), 3))
    for j, part in enumerate(parts):
        forces[:, j, axes] = (F[..., part] * theta[..., None, part]).sum(axis=-1)
    return forces


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
