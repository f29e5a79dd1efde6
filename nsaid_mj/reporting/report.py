"""report.html: one page that says what a run has found, readable without any viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import evaluation
from ..evaluation import Truth
from ..evaluation.confidence import INTERVAL
from ..experiment.loop import Run
from ..parameters import Array, ParameterSpace
from ..resources import write_text
from .drawer import Drawer
from .pages import render
from .panels import Panel, template_figure, thin

FILE = "report.html"
_OPEN = 12  # parameters of a block or of all, up to which nothing is collapsed
_ABSENT = "–"


def write(
    run: Run, summary: dict[str, Any], truth: Truth | None, drawer: Drawer | None = None
) -> Path:
    """Writes a run's report.html, whole or not at all, and returns its path.

    Args:
        run: a run that has ended, with at least one row in its record.
        summary: its summary.json.
        truth: the true parameters; None where nobody knows them, as on a robot's log. What
            compares with the truth is left out then.
        drawer: draws the curves; this process does where there is none.
    """
    path = run.folder / FILE
    write_text(path, page(run, summary, truth, drawer))
    return path


def page(
    run: Run, summary: dict[str, Any], truth: Truth | None, drawer: Drawer | None = None
) -> str:
    """A run's report as HTML; see `write`."""
    panels = [panel for panel in _panels(run, truth) if panel.curves]
    drawings = (drawer or Drawer()).draw(panels)
    return render(
        "report.html",
        name=run.folder.name,
        folder=run.folder,
        robot=_robot(run),
        lead=_lead(summary),
        verdict=summary.get("verdict"),
        ended=_ended(summary),
        mismatch=summary.get("mismatch", []),
        fault=summary.get("fault"),
        figures=_figures(summary),
        checks=_checks(summary),
        curves=[
            template_figure(panel.title, drawing, panel.legend)
            for panel, drawing in zip(panels, drawings, strict=True)
        ],
        confidence=_confidence(summary),
        p=summary["p"],
        r=summary["r"],
        unobservable=evaluation.unobservable_lines(summary),
        parameters_note=_parameters_note(summary),
        parameters=_parameters(run.system.space, summary),
        seed=summary["seed"],
        scenario_hash=summary["scenario_hash"],
        versions=", ".join(f"{name} {number}" for name, number in summary["versions"].items()),
    )


def _robot(run: Run) -> str:
    """What the run's robot is called: the field that chooses it, or its plant's class."""
    plant = run.scenario.plant
    chosen = getattr(plant, "robot", "") or getattr(plant, "vehicle", "")
    return Path(chosen).stem if chosen else type(plant).__name__.removesuffix("Plant")


def _lead(summary: dict[str, Any]) -> str:
    return (
        f"Law {summary['law']}, {summary['sensors']} sensors, seed {summary['seed']}: "
        f"{summary['n']} velocities, {summary['p']} parameters, {summary['sim_s']:.4g} s of motion "
        f"in {summary['wall_s']:.1f} s of wall time."
    )


def _ended(summary: dict[str, Any]) -> str:
    """How a run ended early; empty where it completed."""
    if summary["status"] == "completed":
        return ""
    at = f"Ended early: {summary['status']} at t = {summary['status_time']:.4g} s"
    signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
    return f"{at}{signal}. {summary['status_remedy']}"


def _figures(summary: dict[str, Any]) -> dict[str, Any]:
    """The table of every identifier's figures, without those that are absent."""
    identifiers = {evaluation.OWN: summary, **summary["rivals"]}
    lines = [
        [label, *(evaluation.figure(found.get(key), unit) for found in identifiers.values())]
        for label, key, unit in evaluation.FIGURES
        if any(key in found for found in identifiers.values())
    ]
    return {"heads": ["", *identifiers], "lines": lines}


def _checks(summary: dict[str, Any]) -> str:
    """What the theory promises, and whether the run kept it."""
    said = []
    if "lyapunov_violations" in summary:
        said.append(
            f"The Lyapunov function rose by more than the integration error allows in "
            f"{summary['lyapunov_violations']} steps."
        )
    if (drift := summary.get("conserved_drift")) is not None:
        said.append(f"The conserved quantity θ̂ᵀΓ⁻¹θ̂ drifted by {drift:.1e} of itself.")
    levels = [
        f"{summary[key]:.2g} N·m·s in ({equation})"
        for key, equation in (("pe_level_perp", "75"), ("pe_level", "2"))
        if summary.get(key) is not None
    ]
    if levels:
        said.append(f"Level of excitation ε₀ over all windows: at least {', '.join(levels)}.")
    return " ".join(said)


def _panels(run: Run, truth: Truth | None) -> list[Panel]:
    """The run's curves over time."""
    record, space = run.record, run.system.space
    rows = thin(len(record))
    t, later = record["t"][rows], rows[1:]
    names = {"": evaluation.OWN} | {name: name for name in record.rivals}
    distance = Panel("Distance to the true set", "‖P⊥ᵀ θ̂‖ / ‖θ̂‖, of θ/scale [–]", True)
    error = Panel("Velocity error", "rms Δv [rad/s, m/s]", True)
    for name, label in names.items():
        suffix = f"_{name}" if name else ""
        if truth is not None:
            ratio = truth.distance(t, record[f"theta_hat{suffix}"][rows])
            distance.add(t, ratio, label)
        dv = record[f"v_hat{suffix}"][later] - record["v"][later]
        error.add(record["t"][later], np.sqrt(np.mean(dv**2, axis=1)), label)
    gains = _gains(
        space, t, record["theta_hat"][rows], None if truth is None else truth.theta_at(t)
    )
    if truth is None:
        return [gains, error]
    energy = Panel("Lyapunov function", "V [J]", True)
    energy.add(t, evaluation.energy(run, truth)[rows])
    return [distance, gains, error, energy]


def _gains(space: ParameterSpace, t: Array, theta_hat: Array, true: Array | None) -> Panel:
    """Actuator parameters over the true ones, or over the prior where nobody knows the truth."""
    k = space.actuators
    ratio = theta_hat[:, k] / (theta_hat[:1, k] if true is None else true[:, k])
    over = "k̂/k̂(0)" if true is None else "k̂/k"
    title = "Actuators relative to the prior" if true is None else "Actuators: 1 is right"
    panel = Panel(title, f"{over}, over the mean of all [–]", level=1.0)
    for name, share in zip(k, (ratio / ratio.mean(axis=1, keepdims=True)).T, strict=True):
        panel.add(t, share, space.names[name])
    return panel


def _confidence(summary: dict[str, Any]) -> dict[str, Any] | None:
    """What the confidence says, and the directions that are known least; None without one."""
    stated = summary["confidence"]
    if stated is None:
        return None
    worst = [
        [
            ", ".join(f"{weight:+.2f} {name}" for name, weight in row["parameters"].items()),
            f"±{row['deviation']:.2g}",
            "below the noise" if row["below_noise"] else "",
        ]
        for row in stated["worst_known"]
    ]
    return {"lines": evaluation.confidence_lines(summary), "worst": worst}


def _parameters_note(summary: dict[str, Any]) -> str:
    words = "An estimate is right up to the directions above."
    if _true(summary["parameters"]):
        words += (
            " For comparison, prior and estimate are scaled by the one factor that brings the "
            "estimate nearest to the truth in θ/scale."
        )
    if summary["confidence"] is not None:
        words += (
            " The 95 % interval of an actuator is that of its share of all actuators, without the "
            "common scale, which no motion shows."
        )
    return words


def _parameters(space: ParameterSpace, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """A table for every block of θ; those of actuators are open."""
    rows, stated = summary["parameters"], summary["confidence"]
    shares = {} if stated is None else stated["actuators"]
    factor = _common_factor(rows) if _true(rows) else 1.0
    tables = []
    for block, place in space:
        some = rows[place]
        intervals = any(row["name"] in shares for row in some)
        heads = ["parameter", "unit", "prior", "estimate"]
        heads += ["95 % interval"] * intervals + ["true"] * _true(rows)
        lines = []
        for row in some:
            estimate = factor * row["estimate"]
            line = [row["name"], row["unit"], f"{factor * row['prior']:.4g}", f"{estimate:.4g}"]
            if intervals:
                line.append(_interval(estimate, shares.get(row["name"])))
            if _true(rows):
                line.append(f"{row['true']:.4g}")
            lines.append(line)
        shown = block.actuator or len(rows) <= _OPEN
        tables.append({"name": block.name, "open": shown, "heads": heads, "lines": lines})
    return tables


def _true(rows: Sequence[dict[str, Any]]) -> bool:
    """Whether the summary's parameters come with their true values."""
    return all("true" in row for row in rows)


def _common_factor(rows: Sequence[dict[str, Any]]) -> float:
    """By which the estimate comes nearest to the truth in θ/scale."""
    true, estimate = (
        np.array([row[key] / row["scale"] for row in rows]) for key in ("true", "estimate")
    )
    return float(true @ estimate / (estimate @ estimate))


def _interval(estimate: float, deviation: float | None) -> str:
    """The 95 % interval of a value whose relative standard deviation is given."""
    if deviation is None:
        return _ABSENT
    half = INTERVAL * deviation
    ends = sorted((estimate * (1 - half), estimate * (1 + half)))
    return f"{ends[0]:.4g} … {ends[1]:.4g} (±{100 * half:.2g} %)"
