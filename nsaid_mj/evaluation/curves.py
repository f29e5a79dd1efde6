"""What the page of a run draws, as data: curves over time, and predicted and measured forces."""

from dataclasses import replace
from typing import Any

import numpy as np

from ..experiment.loop import Run
from ..parameters import Array
from ..structure.sensing import velocity_labels
from .confidence import INTERVAL
from .figures import CONVERGED, forces_of
from .lyapunov import energy as energy_of
from .panels import COLOURS, LAWS, AnyPanel, Comparison, Panel, local_rms, thin
from .truth import Truth
from .words import OWN, figure, force_units

_POINTS = 600  # of a curve of forces
_TAIL = 0.9  # share of the run after which the stated intervals are drawn


def curves_of(run: Run, summary: dict[str, Any], truth: Truth | None) -> tuple[AnyPanel, ...]:
    """The curves of a run with its summary: over time, then the forces along every velocity.

    Those that compare with the truth are left out if it is None.
    """
    return (*_over_time(run, summary, truth), *_forces(run, truth))


def _over_time(run: Run, summary: dict[str, Any], truth: Truth | None) -> list[Panel]:
    """The run's curves over time; the first carries the verdict."""
    record, rows = run.record, thin(len(run.record))
    t, later = record["t"][rows], rows[1:]
    names = {"": OWN} | {name: name for name in record.rivals}
    distance = Panel(
        "Distance to the true set", "‖P⊥ᵀ θ̂‖ / ‖θ̂‖, of θ/scale [–]", True,
        level=CONVERGED, level_name=f"converged: within {100 * CONVERGED:g} %",
    )  # fmt: skip
    units = ", ".join(dict.fromkeys(run.system.velocity_units))
    error = Panel("Velocity error, rms over short intervals", f"rms Δv [{units}]", True)
    for k, (name, label) in enumerate(names.items()):
        suffix = f"_{name}" if name else ""
        colour = COLOURS[LAWS.get(name or summary["law"], k % len(COLOURS))]
        if truth is not None:
            ratio = truth.distance(t, record.rows(f"theta_hat{suffix}", rows))
            distance.add(t, ratio, label, colour=colour)
        dv = record[f"v_hat{suffix}"][later] - record["v"][later]
        if len(later):
            error.add(*local_rms(record["t"][later], dv), label, colour=colour)
    gains = _gains(run, summary, rows, None if truth is None else truth.theta_at(t))
    energy = Panel("Lyapunov function", "V [J]", True)
    if truth is not None and run.identifiers[""].metric is not None:
        energy.add(t, energy_of(run, truth, rows))
    panels = [distance, gains, error, energy] if truth is not None else [error, gains]
    found = [fault.found for fault in run.faults]
    return [replace(p, events=found, event_name="fault found") for p in panels if p.curves]


def _gains(run: Run, summary: dict[str, Any], rows: Any, true: Array | None) -> Panel:
    """Actuator parameters relative to the true ones, or to the prior if the truth is unknown.

    The intervals that the law states at the end are drawn over the last tenth.
    """
    space, t = run.system.space, run.record["t"][rows]
    k, theta_hat = space.actuators, run.record.rows("theta_hat", rows)
    ratio = theta_hat[:, k] / (theta_hat[:1, k] if true is None else true[:, k])
    over = "k̂/k̂(0)" if true is None else "k̂/k"
    title = "Actuators relative to the " + ("prior" if true is None else "truth (1 is exact)")
    panel = Panel(
        title, f"{over}, relative to the mean [–]", level=1.0,
        band_name="95 % interval, as stated at the end",
    )  # fmt: skip
    stated = (summary["confidence"] or {}).get("actuators", {})
    end = t >= t[0] + _TAIL * (t[-1] - t[0])
    for i, share in zip(k, (ratio / ratio.mean(axis=1, keepdims=True)).T, strict=True):
        band = None
        if space.names[i] in stated and len(k) > 1:
            half = INTERVAL * stated[space.names[i]] * share[-1]
            band = np.where(end, share[-1] - half, np.nan), np.where(end, share[-1] + half, np.nan)
        panel.add(t, share, space.labels[i], band)
    return panel


def _forces(run: Run, truth: Truth | None) -> list[Comparison]:
    """Predicted against measured force along every velocity, the worst predicted first."""
    found = forces_of(run, truth)
    if found is None or not found.measured.any():
        return []
    rows = np.unique(np.linspace(0, len(found.t) - 1, min(len(found.t), _POINTS)).astype(int))
    labels, units = velocity_labels(run.system), force_units(run.system)
    error = found.nrmse
    order = np.argsort(-np.where(np.isfinite(error), error, -1.0), kind="stable")
    panels = []
    for j in order:
        known, number = np.isfinite(error[j]), figure(float(error[j]), "%")
        note = f": error {number}" if known else ", not actuated"
        kind = {"N": "force", "N·m": "torque"}.get(units[j], "generalised force")
        panels.append(
            Comparison(
                f"{labels[j]}{note}", kind, units[j], found.t[rows],
                found.measured[rows, j], found.predicted[rows, j],
                None if found.half is None else found.half[rows, j],
            )
        )  # fmt: skip
    return panels
