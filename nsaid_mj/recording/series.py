"""Time series of a recording: values, names with units, and colours."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from ..evaluation import OWN, Truth, common_factor, force_units
from ..evaluation.confidence import INTERVAL
from ..evaluation.figures import midpoints
from ..evaluation.panels import LAWS, local_rms
from ..experiment.loop import Run
from ..nullspace import Nullspace
from ..parameters import Array, Indices, ParameterSpace
from ..structure.sensing import rate_labels, velocity_labels
from ..structure.system import SecondOrderSystem
from .text import drawable

PALETTE = (  # RGB, readable on a dark and on a light background; hues in the order of the pages'
    (58, 134, 226), (230, 126, 34), (148, 103, 232), (46, 160, 87), (222, 93, 164),
    (190, 148, 20), (20, 164, 170), (178, 92, 205), (112, 132, 160), (150, 117, 82),
    (229, 72, 77), (130, 130, 130),
)  # fmt: skip
_PALE = 0.5  # share of a pale line's colour, mixed with grey
_GREY = 128


@dataclass(frozen=True)
class Curves:
    """The curves of one Rerun entity."""

    path: str  # path of the entity
    names: Sequence[str]  # one for each curve, with its unit
    values: Array  # (N, curves); (0, curves) if they are streamed later
    pale: bool = False  # drawn as a reference, in paler versions of the colours
    steps: bool = False  # drawn as a zero-order hold instead of linear interpolation
    color: int = 0  # index in `PALETTE` of the first curve's colour
    alike: bool = False  # whether all curves have that colour

    def log_style(self, rec: rr.RecordingStream) -> None:
        """Logs the curves' names, colours and widths."""
        places = [0 if self.alike else k for k in range(len(self.names))]
        colors = [PALETTE[(self.color + place) % len(PALETTE)] for place in places]
        if self.pale:
            grey = (1 - _PALE) * _GREY
            colors = [tuple(round(_PALE * c + grey) for c in color) for color in colors]
        rec.log(
            self.path,
            rr.SeriesLines(
                names=[drawable(name) for name in self.names],
                colors=colors,
                widths=[1.5 if self.pale else 2.0] * len(self.names),
                interpolation_mode="StepAfter" if self.steps else "Linear",
            ),
            static=True,
        )


def path(*parts: str) -> str:
    """An entity path made of parts; characters that would need an escape become underscores."""
    return "/".join(
        "".join(c if c.isalnum() or c == "-" else "_" for c in drawable(p)) for p in parts
    )


@dataclass(frozen=True)
class Group:
    """Parameters of one block that have the same unit, and so share a plot."""

    block: str  # name of the block
    path: str  # path of the entity that their curves are below
    title: str  # title of the group, without the unit
    names: list[str]  # labels with units: "gain of elbow_joint [N·m/A]"
    indices: Indices  # (k,) in θ


def groups(space: ParameterSpace) -> list[Group]:
    """The parameters by block and unit."""
    found = []
    for block, place in space:
        units = list(dict.fromkeys(block.units))
        for number, unit in enumerate(units, 1):
            inside = [k for k, own in enumerate(block.units) if own == unit]
            suffix = [str(number)] if len(units) > 1 else []
            entity, title = path("estimate", block.name, *suffix), f"{block.name} [{unit}]"
            names = [f"{block.labels[k]} [{unit}]" for k in inside]
            indices = place.start + np.array(inside, dtype=np.intp)
            found.append(Group(block.name, entity, title, names, indices))
    return found


def velocity_names(system: SecondOrderSystem, mark: str = "Δ") -> list[str]:
    """Names of the velocities, or of their errors, with units and the prefix `mark`."""
    named = zip(rate_labels(system), system.velocity_units, strict=True)
    return [f"{mark}{label} [{unit}]" for label, unit in named]


def command_names(system: SecondOrderSystem) -> list[str]:
    """Names of the commands: those of the joints where there is one for each."""
    if system.n_u == system.n and not system.group:
        return [f"command of {label} [–]" for label in velocity_labels(system)]
    return [f"command {i} [–]" for i in range(1, system.n_u + 1)]


def excitation(everywhere: Array, perpendicular: Array) -> list[Curves]:
    """Curves of the online excitation levels (N, 1) of (2) and (75), held between windows."""
    return [
        Curves("excitation/all", ["all directions, (2) [N·m·s]"], everywhere, steps=True),
        Curves(
            "excitation/perpendicular", ["observable directions, (75) [N·m·s]"], perpendicular,
            steps=True, color=1,
        ),
    ]  # fmt: skip


def shares(theta_hat: Array, truth: Array) -> Array:
    """(N, k) ratios of estimate to truth, both (N, k), over their mean; 1 where exact."""
    ratio = theta_hat / truth
    return ratio / ratio.mean(axis=1, keepdims=True)


def shared(space: ParameterSpace, r: int, truth: Array) -> Indices:
    """Indices of the parameters whose ratios to the truth are shown relative to their mean.

    These are the actuators if there are several. With a single actuator they are all parameters,
    provided that the common scale is the only unobservable direction and no true value is zero;
    otherwise there are none.
    """
    if len(space.actuators) > 1:
        return space.actuators.astype(np.intp)
    whole = r == 1 and len(space) <= len(PALETTE) and np.abs(truth).min() > 0
    return np.arange(len(space)) if whole else np.zeros(0, dtype=np.intp)


def curves(run: Run, nullspace: Nullspace, rows: Indices, truth: Truth | None) -> list[Curves]:
    """All curves of a run.

    Args:
        run: a finished run.
        nullspace: P_s(θ) and P_⊥(θ).
        rows: (N,) indices of the rows of the record to show.
        truth: true parameters of the run's plant; None if it is unknown.
    """
    record, system = run.record, run.system
    units = ", ".join(dict.fromkeys(system.velocity_units))
    v = record["v"][rows]
    found = [
        Curves("velocity_error", velocity_names(system), record["v_hat"][rows] - v),
        *excitation(record["pe"][rows, None], record["pe_perp"][rows, None]),
        Curves("velocity", velocity_names(system, ""), v),
        Curves("command", command_names(system), record["u"][rows]),
    ]
    found += _estimates(run, rows, truth)
    found += _conserved(run, rows)
    found += _predictions(run, rows) if truth is None else _judged(run, nullspace, rows, truth)
    t = record["t"][rows]
    for k, name in enumerate(["", *record.rivals]):
        suffix, title = (f"_{name}", name) if name else ("", OWN)
        dv = record[f"v_hat{suffix}"][rows] - v
        moved = np.any(dv != 0, axis=1)  # at first Δv may be 0, whose logarithm is infinite
        rms = np.interp(t, *local_rms(t[moved], dv[moved])) if moved.any() else np.ones(len(t))
        entity, names = path("log_velocity_rms", title), [f"{title} [log₁₀ of {units}]"]
        found.append(Curves(entity, names, np.log10(rms)[:, None], color=_colour(run, name, k)))
    return found


def _estimates(run: Run, rows: Indices, truth: Truth | None) -> list[Curves]:
    """θ̂ by block and unit and, if the truth is known, the true θ at the same common scale."""
    space, theta_hat = run.system.space, run.record.rows("theta_hat", rows)
    true = None
    if truth is not None:
        true = truth.theta_at(run.record["t"][rows])
        true = true / common_factor(theta_hat, true, space.scale, space.actuators)[:, None]
    found = []
    for group in groups(space):
        k = group.indices
        found.append(Curves(f"{group.path}/estimated", group.names, theta_hat[:, k]))
        if true is not None:
            names = ["true direction"] * len(k)
            found.append(Curves(f"{group.path}/true_direction", names, true[:, k], pale=True))
    return found


def intervals(run: Run, summary: dict[str, Any], rows: Indices) -> list[Curves]:
    """The 95 % intervals that the law states at the end, over the last tenth of the run.

    There are two lines for each actuator, around its estimate in its unit.
    """
    stated, space = summary["confidence"], run.system.space
    if stated is None:
        return []
    t, theta = run.record["t"][rows], run.record.rows("theta_hat", -1)
    last = t >= t[0] + 0.9 * (t[-1] - t[0])
    found = []
    for group in groups(space):
        halves = [INTERVAL * stated["actuators"].get(space.names[k], np.nan) for k in group.indices]
        if np.isnan(halves).any():
            continue
        ends = theta[group.indices] * (1 + np.outer([-1, 1], halves))
        values = np.where(last[:, None], ends.T.reshape(-1), np.nan)
        names = ["95 % interval"] * values.shape[1]
        entity = f"{group.path}/interval"
        found.append(Curves(entity, names, values, pale=True, color=8, alike=True))
    return found


def _colour(run: Run, name: str, k: int) -> int:
    """Place of the colour of the run's law, whose name is empty, or of its k-th rival."""
    return LAWS.get(name or run.scenario.identifier.name, k)


def _conserved(run: Run, rows: Indices) -> list[Curves]:
    """Relative drift of θ̂ᵀ Γ⁻¹ θ̂, which the law conserves, as log₁₀; empty if it does not."""
    record, identifier = run.record, run.identifiers[""]
    if not identifier.conserves:
        return []
    now = identifier.conserved(record.rows("theta_hat", rows)) + record["spent"][rows]
    drift = now / float(identifier.conserved(record.rows("theta_hat", 0))) - 1
    size = np.log10(np.maximum(np.abs(drift), np.finfo(float).eps))
    return [Curves("conserved", ["drift of the conserved quantity [log₁₀]"], size[:, None])]


def _predictions(run: Run, rows: Indices) -> list[Curves]:
    """Predicted velocities v̂, and the two sides of the force balance at the estimate.

    The force balance W(t, x, v, v̇) θ̂ = 0 uses the measured v̇: on one side the forces that the
    motion requires, on the other those of the actuators. It needs the command of every time step
    and is left out if the record skips rows.
    """
    record, system = run.record, run.system
    names = velocity_names(system, "")
    found = [Curves("velocity/predicted", names, record["v_hat"][rows], pale=True)]
    if run.scenario.record_every > 1 or len(record) < 2:
        return found
    log, first = record.log, np.minimum(rows, len(record) - 2)  # the last row has no successor
    parts = [midpoints(log.part(k, k + 2), system, 1) for k in first]
    t, x, v, u, a = (np.concatenate(part) for part in zip(*parts, strict=True))
    terms = system.regressor(t, x, v, a, u) * record.rows("theta_hat", first)[:, None]
    given = terms[..., system.space.actuators].sum(axis=-1)
    units = force_units(system)
    labels = velocity_labels(system)
    names = [f"{label} [{unit}]" for label, unit in zip(labels, units, strict=True)]
    return [
        *found,
        Curves("force/motion", [f"motion {name}" for name in names], terms.sum(axis=-1) - given),
        Curves("force/actuators", [f"actuators {name}" for name in names], -given, pale=True),
    ]


def _judged(run: Run, nullspace: Nullspace, rows: Indices, truth: Truth) -> list[Curves]:
    """Curves that compare the estimates with the truth."""
    from ..evaluation import energy

    record, space, t = run.record, run.system.space, run.record["t"][rows]
    theta_hat, true = record.rows("theta_hat", rows), truth.theta_at(t)
    components = [f"direction {i} [–]" for i in range(1, nullspace.P_perp.shape[1] + 1)]
    found = [Curves("theta_perp", components, theta_hat / space.scale @ nullspace.P_perp)]
    if run.identifiers[""].metric is not None:
        found.append(Curves("lyapunov", ["V of (66) [J]"], energy(run, truth, rows)[:, None]))
    chosen = shared(space, nullspace.r, truth.theta)
    if len(chosen):
        names = [f"{space.labels[i]} [–]" for i in chosen]
        found.append(Curves("share", names, shares(theta_hat[:, chosen], true[:, chosen])))
    for k, name in enumerate(["", *record.rivals]):
        suffix, title = (f"_{name}", name) if name else ("", OWN)
        color = _colour(run, name, k)
        estimate = record.rows(f"theta_hat{suffix}", rows)
        ratio = truth.distance(t, estimate)
        of = [
            ("distance", "[–]", ratio),
            ("log_distance", "[log₁₀]", np.log10(np.maximum(ratio, 1e-16))),
        ]
        if len(chosen):
            error = np.abs(shares(estimate[:, chosen], true[:, chosen]) - 1).max(axis=1)
            of.append(("share_error", "[%]", 100 * error))
        found += [
            Curves(path(what, title), [f"{title} {unit}"], values[:, None], color=color)
            for what, unit, values in of
        ]
    return found


def spread(length: int, most: int) -> Indices:
    """Indices of at most about `most` of `length` rows, evenly spaced, including first and last."""
    stride = max(1, -(-length // most))
    return np.unique(np.append(np.arange(0, length, stride), length - 1))
