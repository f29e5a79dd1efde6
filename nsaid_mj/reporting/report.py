"""report.html: the results of a run on one self-contained page."""

from __future__ import annotations

import shlex
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
from . import pages
from .drawer import Drawer
from .panels import Panel, template_figure, thin

FILE = "report.html"
_OPEN = 12  # parameters in total, up to which no table is collapsed
_ABSENT = "–"
_SCRIPT = """\
from pathlib import Path

from nsaid_mj import Scenario, run

run(Scenario.from_json(Path("scenario.json").read_text()), Path("again"))"""


def write(
    run: Run, summary: dict[str, Any], truth: Truth | None, drawer: Drawer | None = None
) -> Path:
    """Writes a run's report.html atomically and returns its path.

    Args:
        run: a finished run with at least one row in its record.
        summary: the content of its summary.json.
        truth: of its plant; None if it is unknown, as on a robot's log. Comparisons with the
            truth are then left out.
        drawer: draws the curves; None draws them in this process.
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
    figures = [
        template_figure(panel.title, drawing, panel.legend)
        for panel, drawing in zip(panels, drawings, strict=True)
    ]
    return pages.render(
        "report.html",
        name=run.folder.name,
        eyebrow=f"run {run.folder.name}",
        heading=_robot(run),
        lead=_lead(summary),
        verdict=_verdict(summary),
        carrying=figures[:1],
        alarms=_alarms(summary),
        figures=_figures(summary),
        checks=_checks(summary),
        curves=figures[1:],
        confidence=_confidence(summary),
        observable=evaluation.observable_line(summary),
        unobservable=evaluation.unobservable_lines(summary),
        parameters_note=_parameters_note(summary),
        parameters=_parameters(run.system.space, summary),
        again=_again(run, summary),
    )


def _verdict(summary: dict[str, Any]) -> dict[str, str] | None:
    """The verdict with its colour; None if the summary, of an earlier version, has none."""
    told = summary.get("verdict")
    if told is None:
        return None
    kind = {"converged": "good", "still converging": "fair"}.get(told.partition(":")[0], "poor")
    return pages.verdict(kind, told)


def _alarms(summary: dict[str, Any]) -> list[dict[str, str]]:
    """How the run ended early, and what distinguishes it from one in the paper."""
    found = []
    if summary["status"] != "completed":
        found.append(pages.alarm(_ended(summary), "poor", "ended early:", "✘"))
    if summary.get("fault"):
        found.append(pages.alarm(summary["fault"], level="fault in the plant:"))
    for fault in summary.get("faults", []):
        words = f"{fault['words']}, {100 * fault['confidence']:.4g} % sure"
        found.append(pages.alarm(words, "poor", f"fault found at {fault['found']:.4g} s:"))
    found += [pages.alarm(m, level="not in the structure:") for m in summary.get("mismatch", [])]
    if summary["sensor_noise"]:
        found.append(pages.alarm(summary["sensor_noise"], "weak", "sensors:", "·"))
    return found


def _again(run: Run, summary: dict[str, Any]) -> dict[str, Any]:
    folder = shlex.quote(str(run.folder))
    return pages.again(
        [_SCRIPT, f"nsaid view {folder}", f"nsaid verify --run {folder}"],
        summary["versions"],
        f"The scenario, including seed {summary['seed']}, is in scenario.json (hash "
        f"{summary['scenario_hash']}). With the same versions of all packages the record is "
        "identical to the bit. All figures are in summary.json, all samples in record.arrow, the "
        "recording is run.rrd.",
    )


def _robot(run: Run) -> str:
    """The robot's name: the plant's `robot` or `vehicle` field, or the name of its class."""
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
    signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
    at = f"{summary['status']} at t = {summary['status_time']:.4g} s{signal}"
    return f"{at}. {summary['status_remedy']}"


def _figures(summary: dict[str, Any]) -> dict[str, Any]:
    """The table of figures, one column for each identifier; rows absent from all are left out."""
    identifiers = {evaluation.OWN: summary, **summary["rivals"]}
    lines = [
        [label, *(evaluation.figure(found.get(key), unit) for found in identifiers.values())]
        for label, key, unit in evaluation.FIGURES
        if any(key in found for found in identifiers.values())
    ]
    return {"heads": ["", *identifiers], "lines": lines}


def _checks(summary: dict[str, Any]) -> str:
    """How far the run agrees with the theory: Lyapunov function, conserved quantity, excitation."""
    said = []
    if summary.get("lyapunov_violations") is not None:
        said.append(
            f"The Lyapunov function rose by more than the integration error in "
            f"{summary['lyapunov_violations']} time steps."
        )
    if (drift := summary.get("conserved_drift")) is not None:
        said.append(f"Relative drift of the conserved quantity θ̂ᵀΓ⁻¹θ̂: {drift:.1e}.")
    levels = [
        f"{summary[key]:.2g} N·m·s in ({equation})"
        for key, equation in (("pe_level_perp", "75"), ("pe_level", "2"))
        if summary.get(key) is not None
    ]
    if levels:
        said.append(f"Smallest level of excitation ε₀ of any window: {', '.join(levels)}.")
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
    energy.add(t, evaluation.energy(run, truth, rows))
    return [distance, gains, error, energy]


def _gains(space: ParameterSpace, t: Array, theta_hat: Array, true: Array | None) -> Panel:
    """Actuator parameters relative to the true ones, or to the prior if the truth is unknown."""
    k = space.actuators
    ratio = theta_hat[:, k] / (theta_hat[:1, k] if true is None else true[:, k])
    over = "k̂/k̂(0)" if true is None else "k̂/k"
    title = "Actuators relative to the " + ("prior" if true is None else "truth (1 is exact)")
    panel = Panel(title, f"{over}, relative to the mean [–]", level=1.0)
    for i, share in zip(k, (ratio / ratio.mean(axis=1, keepdims=True)).T, strict=True):
        panel.add(t, share, space.labels[i])
    return panel


def _confidence(summary: dict[str, Any]) -> dict[str, Any] | None:
    """The stated confidence in words, and the least known directions; None if none is stated."""
    stated = summary["confidence"]
    if stated is None:
        return None
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    worst = [
        [
            ", ".join(f"{weight:+.2f} {label[name]}" for name, weight in row["parameters"].items()),
            f"±{row['deviation']:.2g}",
            "below the noise" if row["below_noise"] else "",
        ]
        for row in stated["worst_known"]
    ]
    return {"lines": evaluation.confidence_lines(summary), "worst": worst}


def _parameters_note(summary: dict[str, Any]) -> str:
    words = "Estimates are determined up to the unobservable directions above."
    if _true(summary["parameters"]):
        words += (
            " For comparison, prior and estimate are multiplied by the one factor that brings the "
            "estimate closest to the truth in θ/scale."
        )
    if summary["confidence"] is not None:
        words += (
            " The 95 % interval of an actuator is that of its gain relative to the mean of all; "
            "their common scale is unobservable."
        )
    return words


def _parameters(space: ParameterSpace, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """A table for each block of θ; those of actuators are expanded."""
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
            line = [row["label"], row["unit"], f"{factor * row['prior']:.4g}", f"{estimate:.4g}"]
            if intervals:
                line.append(_interval(estimate, shares.get(row["name"])))
            if _true(rows):
                line.append(f"{row['true']:.4g}")
            lines.append(line)
        shown = block.actuator or len(rows) <= _OPEN
        tables.append(pages.block(block.name, heads, lines, text=(0, 1), open=shown))
    return tables


def _true(rows: Sequence[dict[str, Any]]) -> bool:
    """Whether the parameters of a summary include their true values."""
    return all("true" in row for row in rows)


def _common_factor(rows: Sequence[dict[str, Any]]) -> float:
    """The factor that brings the estimate closest to the truth in θ/scale, by least squares."""
    true, estimate = (
        np.array([row[key] / row["scale"] for row in rows]) for key in ("true", "estimate")
    )
    return float(true @ estimate / (estimate @ estimate))


def _interval(estimate: float, deviation: float | None) -> str:
    """The 95 % interval of a value, from its relative standard deviation; – if that is None."""
    if deviation is None:
        return _ABSENT
    half = INTERVAL * deviation
    ends = sorted((estimate * (1 - half), estimate * (1 + half)))
    return f"{ends[0]:.4g} … {ends[1]:.4g} (±{100 * half:.2g} %)"
