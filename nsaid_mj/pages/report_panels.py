"""The contents of the figures of a run's report."""

from dataclasses import replace
from typing import Any

import numpy as np

from .. import evaluation
from ..evaluation import Truth
from ..evaluation.confidence import INTERVAL
from ..evaluation.result import Result
from ..evaluation.words import CONVERGED, figure
from ..experiment.loop import Run
from ..parameters import Array
from .panels import COLOURS, LAWS, AnyPanel, Comparison, HeatMap, Panel, local_rms, thin
from .parameters import correlations, forests

_FORCES = 600  # points of a curve of forces
_TAIL = 0.9  # share of the run after which the stated intervals are drawn


def panels(
    run: Run, summary: dict[str, Any], result: Result, truth: Truth | None
) -> dict[str, list[AnyPanel]]:
    """All panels of the page: `carrying` the verdict, `curves`, `gains`, `forces`, `correlations`.

    The run must have at least one row; `summary` is the content of its summary.json, `result` its
    result; without the plant's truth, comparisons with it are left out.
    """
    rows = thin(len(run.record))
    curves = [panel for panel in _over_time(run, summary, truth, rows) if panel.curves]
    stated = [p for p in result.gains if p.relative is not None]
    return {
        "carrying": [*curves[:2]],
        "curves": [*curves[2:]],
        "gains": [*forests(stated)],
        "forces": [*_forces(run, truth)],
        "correlations": [*_correlations(summary)],
    }


def _over_time(run: Run, summary: dict[str, Any], truth: Truth | None, rows: Any) -> list[Panel]:
    """The run's curves over time; the first carries the verdict."""
    record = run.record
    t, later = record["t"][rows], rows[1:]
    names = {"": evaluation.OWN} | {name: name for name in record.rivals}
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
    if truth is not None:
        energy.add(t, evaluation.energy(run, truth, rows))
    panels = [distance, gains, error, energy] if truth is not None else [error, gains]
    found = [fault.found for fault in run.faults]
    return [replace(panel, events=found, event_name="fault found") for panel in panels]


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
    found = evaluation.forces_of(run, truth)
    if found is None or not found.measured.any():
        return []
    rows = np.unique(np.linspace(0, len(found.t) - 1, min(len(found.t), _FORCES)).astype(int))
    labels, units = evaluation.velocity_labels(run.system), evaluation.force_units(run.system)
    error = found.nrmse
    order = np.argsort(-np.where(np.isfinite(error), error, -1.0), kind="stable")
    panels = []
    for j in order:
        note = (
            f": error {figure(float(error[j]), '%')}" if np.isfinite(error[j]) else ", not actuated"
        )
        kind = {"N": "force", "N·m": "torque"}.get(units[j], "generalised force")
        panels.append(
            Comparison(
                f"{labels[j]}{note}", kind, units[j], found.t[rows],
                found.measured[rows, j], found.predicted[rows, j],
                None if found.half is None else found.half[rows, j],
            )
        )  # fmt: skip
    return panels


def _correlations(summary: dict[str, Any]) -> list[HeatMap]:
    """Correlations of the parameters that are identified."""
    stated = (summary["confidence"] or {}).get("correlations", {"parameters": [], "lower": []})
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    r = np.eye(len(stated["lower"]))
    for i, row in enumerate(stated["lower"]):
        r[i, :i] = r[:i, i] = row
    return correlations([label[name] for name in stated["parameters"]], r)
