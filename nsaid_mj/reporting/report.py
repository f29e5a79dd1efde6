"""report.html: one page that says what a run has found, readable without any viewer."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import numpy as np

from .. import evaluation
from ..evaluation import Truth
from ..experiment.loop import Run
from ..resources import write_text
from .charts import Chart, svg

FILE = "report.html"
_POINTS = 1500  # of a curve
_COLOURS = ("#0b6e99", "#d9480f", "#5f3dc4", "#2b8a3e", "#c2255c")

_SCALED = """ For comparison it is scaled by the one factor that brings it nearest to the truth in
θ/scale."""

STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#1c2733;max-width:68rem;
margin:2rem auto;padding:0 1rem}
h1{margin-bottom:0}h2{margin-top:2.2rem;border-bottom:1px solid #d5dde5;padding-bottom:.2rem}
.lead{color:#51606f;margin-top:.2rem}table{border-collapse:collapse;font-variant-numeric:tabular-nums}
td,th{padding:.2rem .8rem;text-align:right;border-bottom:1px solid #e6ecf1}
td:first-child,th:first-child{text-align:left}img,svg{width:100%}.bad{color:#c92a2a;font-weight:600}
code{background:#f0f4f7;padding:.1rem .3rem;border-radius:3px}
.scroll{max-height:32rem;overflow:auto}
.scroll th{position:sticky;top:0;background:#fff}
"""


def write(run: Run, summary: dict[str, Any], truth: Truth | None) -> Path:
    """Writes a run's report.html, whole or not at all, and returns its path.

    Args:
        run: a run that has ended, however it did.
        summary: its summary.json.
        truth: of its plant; None leaves out whatever needs it.
    """
    name = html.escape(run.folder.name)
    ended = "" if summary["status"] == "completed" else (
        f'<p class="bad">Ended early: {html.escape(summary["status"])} at t = '
        f'{summary["status_time"]:.4g} s {html.escape(summary["status_signal"])}. '
        f'{html.escape(summary["status_remedy"])}</p>'
    )  # fmt: skip
    mismatch = "".join(f"<li>{html.escape(words)}</li>" for words in summary.get("mismatch", []))
    if mismatch:
        ended += f"<h2>What the structure does not know</h2><ul>{mismatch}</ul>"
    if summary.get("fault"):
        ended += f"<h2>Fault</h2><p>{html.escape(summary['fault'])}</p>"
    versions = ", ".join(f"{name} {number}" for name, number in summary["versions"].items())
    page = f"""<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>{name}</title><style>{STYLE}</style>
<h1>{name}</h1>
<p class="lead">{html.escape(type(run.scenario.plant).__name__)}, {summary["n"]} velocities,
{summary["p"]} parameters, {summary["sim_s"]:.4g} s simulated in {summary["wall_s"]:.1f} s,
{html.escape(summary["sensors"])} sensors, seed {summary["seed"]}</p>{ended}
<h2>What was found</h2>{_figures(summary)}
<h2>How it went</h2>{_curves(run, truth)}
{_confidence(summary)}<h2>What cannot be known</h2>{_unobservable(summary)}
<h2>Parameters</h2><p>An estimate is right up to the directions above.{_SCALED if truth else ""}</p>
<div class="scroll">{_parameters(summary)}</div>
<h2>To run it again</h2><p>{html.escape(versions)};
scenario {summary["scenario_hash"]} in <code>scenario.json</code>; all figures in
<code>summary.json</code>, all samples in <code>record.arrow</code>, the motion in
<code>run.rrd</code> (<code>nsaid view {html.escape(str(run.folder))}</code>).</p></html>
"""
    path = run.folder / FILE
    write_text(path, page)
    return path


def _figures(summary: dict[str, Any]) -> str:
    identifiers = {evaluation.OWN: summary, **summary["rivals"]}
    head = "".join(f"<th>{html.escape(name)}</th>" for name in identifiers)
    body = "".join(
        f"<tr><td>{label}</td>"
        + "".join(f"<td>{evaluation.figure(s.get(key), unit)}</td>" for s in identifiers.values())
        + "</tr>"
        for label, key, unit in evaluation.FIGURES
        if any(key in s for s in identifiers.values())
    )
    drift = summary["conserved_drift"]
    drifted = "–" if drift is None else f"{drift:.1e}"
    checks = (
        f"<p>The conserved quantity θ̂ᵀΓ⁻¹θ̂ drifted by {drifted}. Excitation: ε₀ of (2) at least "
        f"{summary['pe_level']:.2g} N·m·s.</p>"
    )
    if "lyapunov_violations" in summary:
        checks = (
            f"<p>The Lyapunov function rose beyond the integrator's bound in "
            f"{summary['lyapunov_violations']} steps; the conserved quantity θ̂ᵀΓ⁻¹θ̂ drifted by "
            f"{drifted}. Excitation: ε₀ of (75) at least "
            f"{summary['pe_level_perp']:.2g} N·m·s, of (2) {summary['pe_level']:.2g} N·m·s.</p>"
        )
    return f"<table><tr><th></th>{head}</tr>{body}</table>{checks}"


def _curves(run: Run, truth: Truth | None) -> str:
    """The run's curves, as SVG."""
    record = run.record
    k = slice(None, None, max(1, len(record) // _POINTS))
    t = record["t"][k]
    distance = Chart("‖θ̄_P⊥‖ / ‖θ̂‖", "distance to the true set", logarithmic=True)
    error = Chart("rms Δv [rad/s or m/s]", logarithmic=True)
    for name, colour in zip(["", *record.rivals], _COLOURS, strict=False):
        suffix, label = (f"_{name}", name) if name else ("", evaluation.OWN)
        if truth is not None:
            ratio = truth.distance(t, record[f"theta_hat{suffix}"][k])
            distance.add(t, ratio, colour, label if record.rivals else "")
        dv = record[f"v_hat{suffix}"][k] - record["v"][k]
        error.add(t[1:], np.sqrt(np.mean(dv[1:] ** 2, axis=1)), colour)
    if truth is None:
        return svg([error])
    gains = Chart("k̂/k over its mean", "actuator gains, up to the common scale: 1 is right")
    actuators = run.system.space.actuators
    ratio = record["theta_hat"][k][:, actuators] / truth.theta_at(t)[:, actuators]
    for share in (ratio / ratio.mean(axis=1, keepdims=True)).T:
        gains.add(t, share)
    energy = Chart("Lyapunov function V [J]", logarithmic=True)
    energy.add(t, evaluation.energy(run, truth)[k], _COLOURS[0])
    return svg([distance, gains, error, energy])


def _confidence(summary: dict[str, Any]) -> str:
    stated = summary["confidence"]
    if stated is None:
        return ""
    told = "".join(f"<li>{html.escape(line)}</li>" for line in evaluation.confidence_lines(summary))
    body = ""
    for row in stated["worst_known"]:
        parts = ", ".join(f"{weight:+.2f} {name}" for name, weight in row["parameters"].items())
        low = "below the noise" if row["below_noise"] else ""
        body += (
            f"<tr><td>{html.escape(parts)}</td><td>±{row['deviation']:.2g}</td><td>{low}</td></tr>"
        )
    gains = "".join(
        f"<tr><td>{html.escape(name)}</td><td>±{100 * s:.2g} %</td></tr>"
        for name, s in stated["actuators"].items()
    )
    return (
        f"<h2>How well it is known</h2><ul>{told}</ul>"
        f'<div class="scroll"><table><tr><th>least known directions of θ/scale (largest parts)</th>'
        f"<th>of ‖θ̂/scale‖</th><th></th></tr>{body}</table></div>"
        f"<table><tr><th>actuator</th><th>its share</th></tr>{gains}</table>"
    )


def _unobservable(summary: dict[str, Any]) -> str:
    items = "".join(
        f"<li>{html.escape(what)}: {html.escape(fix)}.</li>"
        for what, fix in evaluation.unobservable_lines(summary)
    )
    return (
        f"<p>{summary['p'] - summary['r']} of {summary['p']} directions of θ show in the motion, "
        f"{summary['r']} do not:</p><ul>{items}</ul>"
    )


def _parameters(summary: dict[str, Any]) -> str:
    rows = summary["parameters"]
    judged, factor = "true" in rows[0], 1.0
    if judged:
        true, estimate, scale = (
            np.array([row[key] for row in rows]) for key in ("true", "estimate", "scale")
        )
        s, h = true / scale, estimate / scale
        factor = (s @ h) / (h @ h)
    body = "".join(
        f"<tr><td>{html.escape(row['name'])}</td><td>{html.escape(row['unit'])}</td>"
        f"<td>{row['prior'] * factor:.4g}</td><td>{row['estimate'] * factor:.4g}</td>"
        + (f"<td>{row['true']:.4g}</td></tr>" if judged else "</tr>")
        for row in rows
    )
    head = "<tr><th>parameter</th><th>unit</th><th>at first</th><th>estimate</th>"
    head += "<th>true</th></tr>" if judged else "</tr>"
    return f"<table>{head}{body}</table>"
