"""Time series of a recording: values, names with units, and colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ..evaluation import OWN, Truth, energy
from ..evaluation.rows import midpoints
from ..experiment.loop import Run
from ..nullspace import Nullspace
from ..parameters import Array, Block, ParameterSpace
from ..system import SecondOrderSystem
from .text import drawable

Indices = NDArray[np.intp]

PALETTE = (  # RGB
    (78, 161, 255), (255, 159, 64), (80, 200, 120), (255, 99, 110), (178, 135, 255),
    (64, 210, 210), (240, 215, 80), (255, 140, 200), (165, 140, 115), (170, 215, 110),
    (140, 160, 190), (230, 230, 230),
)  # fmt: skip
_TWIST = {
    6: ("surge", "sway", "heave", "roll rate", "pitch rate", "yaw rate"),
    3: ("u", "v", "r"),
}  # names of the components of a body's twist, by its dimension
_FORCE_UNITS = {"m/s": "N", "rad/s": "N·m"}  # of the generalised force, by unit of its velocity
_PALE = 0.55  # brightness of a pale line relative to its colour


@dataclass(frozen=True)
class Curves:
    """The curves of one Rerun entity.

    Attributes:
        path: of the entity.
        names: one for each curve, with its unit.
        values: (N, curves); (0, curves) if they are streamed later.
        pale: drawn as a reference, in paler versions of the colours.
        steps: drawn as a zero-order hold instead of linear interpolation.
        color: index in `PALETTE` of the first curve's colour.
    """

    path: str
    names: Sequence[str]
    values: Array
    pale: bool = False
    steps: bool = False
    color: int = 0

    def log_style(self, rec: rr.RecordingStream) -> None:
        """Logs the curves' names, colours and widths."""
        colors = [PALETTE[(self.color + i) % len(PALETTE)] for i in range(len(self.names))]
        if self.pale:
            colors = [tuple(round(_PALE * c + 20) for c in color) for color in colors]
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

    def log_values(self, rec: rr.RecordingStream, t: Array) -> None:
        """Logs all values in one batch, at times t (N,) [s]."""
        time = rr.TimeColumn("sim_time", duration=t)
        rec.send_columns(self.path, [time], rr.Scalars.columns(scalars=self.values))


def path(*parts: str) -> str:
    """An entity path made of parts; characters that would need an escape become underscores."""
    return "/".join(
        "".join(c if c.isalnum() or c == "-" else "_" for c in drawable(p)) for p in parts
    )


def estimate_names(block: Block) -> list[str]:
    """Labels of a block's parameters, each with its scale as the unit: "gain of elbow [20 N·m]"."""
    return [
        f"{label} [{scale:.3g} {unit}]"
        for label, scale, unit in zip(block.labels, block.scale, block.units, strict=True)
    ]


def velocity_names(system: SecondOrderSystem, mark: str = "Δ") -> list[str]:
    """Names of the velocities, or of their errors, with units.

    The components of a body's twist have names (surge, sway, …) and are followed by numbered joint
    rates; the velocities of all other systems are numbered.

    Args:
        system: whose velocities are named.
        mark: prefix of every name.
    """
    units, twist = system.velocity_units, _TWIST.get(system.group, ())
    other = "joint rate" if twist else "v"
    names = [*twist, *(f"{other}_{i}" for i in range(1, len(units) - len(twist) + 1))]
    return [f"{mark}{name} [{unit}]" for name, unit in zip(names, units, strict=True)]


def excitation(everywhere: Array, perpendicular: Array) -> list[Curves]:
    """Curves of the online excitation levels (N, 1) of (2) and (75), held between windows."""
    return [
        Curves("excitation/all", ["all of θ (2) [N·m·s]"], everywhere, steps=True),
        Curves(
            "excitation/perpendicular",
            ["within P⊥ (75) [N·m·s]"],
            perpendicular,
            steps=True,
            color=1,
        ),
    ]


def shares(theta_hat: Array, truth: Array) -> Array:
    """(N, k) ratios of estimate to truth, both (N, k), over their mean; 1 where exact."""
    ratio = theta_hat / truth
    return ratio / ratio.mean(axis=1, keepdims=True)


def along(theta_s: Array, true_s: Array) -> Array:
    """(N,) factors that bring the truth (N, p) closest to the estimate (N, p), in θ/scale."""
    return np.sum(theta_s * true_s, axis=1) / np.sum(true_s**2, axis=1)


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
        truth: of the run's plant; None if it is unknown.
    """
    record, system = run.record, run.system
    found = [
        Curves(
            "velocity_error",
            velocity_names(system),
            record["v_hat"][rows] - record["v"][rows],
        ),
        *excitation(record["pe"][rows, None], record["pe_perp"][rows, None]),
        Curves("velocity", velocity_names(system, ""), record["v"][rows]),
        Curves("command", [f"u_{i} [1]" for i in range(1, system.n_u + 1)], record["u"][rows]),
    ]
    found += _estimates(run, rows, truth)
    found += _conserved(run, rows)
    found += _predictions(run, rows) if truth is None else _judged(run, nullspace, rows, truth)
    for k, name in enumerate(["", *record.rivals]):
        suffix, title = (f"_{name}", name) if name else ("", OWN)
        dv = record[f"v_hat{suffix}"][rows] - record["v"][rows]
        rms = np.sqrt(np.mean(dv**2, axis=1))
        found.append(
            Curves(path("velocity_rms", title), [f"{title} rms Δv [SI]"], rms[:, None], color=k)
        )
    return found


def _estimates(run: Run, rows: Indices, truth: Truth | None) -> list[Curves]:
    """θ̂/scale by block and, if the truth is known, the true θ scaled as close as possible to θ̂."""
    space = run.system.space
    theta_s = run.record["theta_hat"][rows] / space.scale
    found = [
        Curves(path("estimate", block.name, "estimated"), estimate_names(block), theta_s[:, place])
        for block, place in space
    ]
    if truth is None:
        return found
    true_s = truth.theta_at(run.record["t"][rows]) / space.scale
    direction = along(theta_s, true_s)[:, None] * true_s
    return found + [
        Curves(
            path("estimate", block.name, "true_direction"),
            ["true direction"] * len(block),
            direction[:, place],
            pale=True,
        )
        for block, place in space
    ]


def _conserved(run: Run, rows: Indices) -> list[Curves]:
    """Relative drift of θ̂ᵀ Γ⁻¹ θ̂, which the law conserves, as log₁₀; empty if it does not."""
    record, identifier = run.record, run.identifiers[""]
    if not identifier.conserves:
        return []
    now = identifier.conserved(record["theta_hat"][rows]) + record["spent"][rows]
    drift = now / float(identifier.conserved(record["theta_hat"][0])) - 1
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
    terms = system.regressor(t, x, v, a, u) * record["theta_hat"][first][:, None]
    given = terms[..., system.space.actuators].sum(axis=-1)
    units = [_FORCE_UNITS.get(unit, "SI") for unit in system.velocity_units]
    names = [f"{i} [{unit}]" for i, unit in enumerate(units, 1)]
    return [
        *found,
        Curves("force/motion", [f"motion {name}" for name in names], terms.sum(axis=-1) - given),
        Curves("force/actuators", [f"actuators {name}" for name in names], -given, pale=True),
    ]


def _judged(run: Run, nullspace: Nullspace, rows: Indices, truth: Truth) -> list[Curves]:
    """Curves that compare the estimates with the truth."""
    record, space, t = run.record, run.system.space, run.record["t"][rows]
    theta_hat, true = record["theta_hat"][rows], truth.theta_at(t)
    components = [f"θ̄_P⊥ {i} [1]" for i in range(1, nullspace.P_perp.shape[1] + 1)]
    found = [
        Curves("theta_perp", components, theta_hat / space.scale @ nullspace.P_perp),
        Curves("lyapunov", ["V (66) [J]"], energy(run, truth, rows)[:, None]),
    ]
    chosen = shared(space, nullspace.r, truth.theta)
    if len(chosen):
        names = [f"{space.labels[i]} [1]" for i in chosen]
        found.append(Curves("share", names, shares(theta_hat[:, chosen], true[:, chosen])))
    for k, name in enumerate(["", *record.rivals]):
        suffix, title = (f"_{name}", name) if name else ("", OWN)
        estimate = record[f"theta_hat{suffix}"][rows]
        ratio = truth.distance(t, estimate)
        of = [
            ("distance", "[1]", ratio),
            ("log_distance", "[log₁₀]", np.log10(np.maximum(ratio, 1e-16))),
        ]
        if len(chosen):
            error = np.abs(shares(estimate[:, chosen], true[:, chosen]) - 1).max(axis=1)
            of.append(("share_error", "[%]", 100 * error))
        found += [
            Curves(path(what, title), [f"{title} {unit}"], values[:, None], color=k)
            for what, unit, values in of
        ]
    return found
