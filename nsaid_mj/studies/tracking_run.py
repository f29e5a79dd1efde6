"""Carries out a tracking study: progress, files, page, picture and recording."""

import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..numerics.threads import single_threaded
from ..pages import plots
from ..pages.drawings import figures_of
from ..pages.page import Figures, Page, Section, Text, count, markdown, write_html
from ..pages.panels import COLOURS, LAWS, Panel, local_rms
from ..pages.picture import picture
from ..recording import available
from ..robot.findings import Finding
from .study import carried_out, repeated
from .tracking import (
    FILES,
    Course,
    Plan,
    courses,
    medians_in_words,
    print_table,
    table_of,
    verdict_of,
    write,
)


@single_threaded
def run(plan: Plan, folder: Path, quiet: bool = False) -> list[Course]:
    """Runs a study, writes its files, page and recording, and prints the table."""

    def made(say: Callable[[str], object]) -> Iterator[Course]:
        for found in courses(plan, say):
            kept = slice(None) if found.seed == plan.seeds[0] else slice(-1, None)  # for the page
            motion = replace(found.motion, theta_hat=found.motion.theta_hat[kept])
            yield replace(found, motion=motion)

    def drawn(done: list[Course]) -> list[Path]:
        return [folder / name for name in FILES] + (draw(folder, plan, done) if done else [])

    total, show = len(plan.seeds) * len(plan.laws), None if quiet else partial(print_table, plan)
    return carried_out(folder, FILES[:1], total, made, partial(write, folder, plan), drawn, show)


PICTURE, RECORDING = "tracking.png", "tracking.rrd"


def draw(folder: Path, plan: Plan, done: list[Course]) -> list[Path]:
    """Writes report.html, tracking.png and, with Rerun, tracking.rrd; returns their paths."""
    shown = [c for c in done if c.seed == done[0].seed]
    table, length = table_of(plan, done), plan.scenario.duration
    units = [unit for unit in ("rad", "m") if f"rms_{unit}" in shown[0].figures]
    panels = [_errors(shown, unit) for unit in units]
    lines = [{panel.title: partial(plots.curves, panel) for panel in panels}]
    plot = plots.png_of(lines, (1.0 + 6.0 * len(panels), 3.4), folder / PICTURE)
    figures = figures_of(panels, 1)
    sections = [Section("Tracking errors", [table, Text(
        f"{medians_in_words(plan)} “Error” compares the rms error with the conventional law's, in "
        "the median over the seeds. “V rises” counts the steps in which the Lyapunov "
        "function rose by more than its discretisation explains.", note=True,
    )])]  # fmt: skip
    averaged = "Root mean square over the coordinates and over short intervals"
    drawn = Text(f"{averaged}; seed {shown[0].seed}.", note=True)
    if figures[1:]:
        sections.append(Section("Over time", [Figures(figures[1:]), drawn]))
    missing = len(plan.laws) * len(plan.seeds) - len(done)
    words = f"{count(missing, 'run')} {'is' if missing == 1 else 'are'} missing"
    sketch = picture(shown[0].setup.plant, shown[0].motion.q[0], "the robot")
    page = Page(
        heading=plan.script,
        verdict=verdict_of(table),
        eyebrow=f"tracking laws · {folder.name}",
        lead=f"{count(len(plan.laws), 'law')} on {count(len(plan.seeds), 'plant')}, {length:g} s, "
        f"{plan.scenario.sensors} sensors. All laws get the same prior, reference, K_d, Λ and "
        "bandwidth of adaptation.",
        findings=[Finding("refusal", "missing", "not finished", words)] if missing else [],
        carrying=[*figures[:1], *([sketch] if sketch else [])],
        sections=sections,
        commands=[
            repeated("track", plan.manifest, {"laws": plan.laws, "seeds": plan.seeds}),
            *([shlex.join(["nsaid", "view", str(folder / RECORDING)])] if available() else []),
        ],
        notes=["All figures are in tracking.json and tracking.csv."],
        versions=plan.manifest["versions"],
    )
    seed = Section("", [Text(f"Curves and robot: seed {shown[0].seed}.")])
    result = markdown(replace(page, sections=[sections[0], seed]))
    made, setup = [write_html(page, folder), plot], shown[0].setup
    if available():
        from ..recording.tracking import record

        moved = setup.system, setup.plant, {c.law: c.motion for c in shown}, shown[0].tracker
        made.append(record(folder / RECORDING, *moved, result))
    return made


def _errors(shown: list[Course], unit: str) -> Panel:
    """Every law's error over time, in the unit of some coordinates."""
    faults = shown[0].setup.plant.faults
    events = [t for fault in faults for t in (fault.time, fault.until) if t is not None]
    panel = Panel(f"Tracking error [{unit}]", f"rms error [{unit}]", True, events=events)
    for c in shown:
        error = c.motion.error_of(c.setup.system, unit)
        panel.add(*local_rms(c.motion.t, error), c.law, colour=COLOURS[LAWS[c.law]])
    return panel
