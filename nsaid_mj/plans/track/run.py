"""Carries out a tracking study: progress, files, page and recording."""

import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from ...base import installed, single_threaded
from ...report import (
    Figures,
    Page,
    Panel,
    Result,
    Section,
    Text,
    count,
    figures_of,
    robot_picture,
)
from ..studies.study import Study, carried_out, repeated
from .tracking import (
    TRACKING_FILES,
    TrackedCourse,
    courses,
    medians_in_words,
    result_of,
    table_of,
    write,
)

RECORDING = "tracking.rrd"


@single_threaded
def run_tracking(
    study: Study, folder: Path, quiet: bool = False
) -> tuple[Result, list[TrackedCourse]]:
    """Runs a study, writes its files, page and recording, and prints the page."""

    def made(say: Callable[[str], object]) -> Iterator[TrackedCourse]:
        for found in courses(study, say):
            kept = slice(None) if found.seed == study.seeds[0] else slice(-1, None)  # for the page
            motion = replace(found.motion, theta_hat=found.motion.theta_hat[kept])
            yield replace(found, motion=motion)

    total = len(study.seeds) * len(study.vary["law"])
    draw = partial(drawn, folder, study)
    return carried_out(
        folder, TRACKING_FILES[:1], total, made, partial(write, folder, study), draw, quiet
    )


def drawn(folder: Path, study: Study, done: list[TrackedCourse]) -> tuple[Page, list[Path]]:
    """The page; with Rerun, writes tracking.rrd, and returns all files."""
    page = page_of(folder, study, done)
    files = [folder / name for name in TRACKING_FILES]
    if not done:
        return page, files
    if installed("rerun"):
        from .recording import record

        first = done[0]
        files.append(
            record(page, first.setup, first.law, first.motion, first.tracker, folder / RECORDING)
        )
    return page, files


def page_of(folder: Path, study: Study, done: list[TrackedCourse]) -> Page:
    """The page of a study."""
    result = result_of(study, done)
    seed = done[0].seed if done else study.seeds[0]
    figures = figures_of([p for p in result.curves if isinstance(p, Panel) and p.page], 1)
    sketch = [robot_picture(done[0].setup.plant, done[0].motion.q[0], "the robot")] if done else []
    averaged = "Root mean square over the coordinates and over short intervals"
    note = (
        "“Error” compares the rms error with the conventional law's, in the median over the seeds. "
        "“V rises” counts the steps in which the Lyapunov function rose by more than its "
        "discretisation explains."
    )
    sections = [
        Section(
            "Tracking errors",
            [
                table_of(study, result.statistics),
                Text(medians_in_words(study)),
            ],
            brief=True,
        ),
        Section("", [Text(f"Curves and robot: seed {seed}. {note}", note=True)]),
        Section(
            "Over time",
            [
                Figures(figures[1:]),
                Text(f"{averaged}; seed {seed}.", note=True),
            ]
            if figures[1:]
            else [],
        ),
    ]
    return Page(
        heading=study.script,
        result=result,
        eyebrow=f"tracking laws · {folder.name}",
        lead=f"{count(len(study.vary['law']), 'law')} on {count(len(study.seeds), 'plant')}, "
        f"{study.scenario.duration:g} s, {study.scenario.sensors} sensors. All laws get the same "
        "prior, reference, K_d, Λ and bandwidth of adaptation.",
        carrying=[*figures[:1], *filter(None, sketch)],
        sections=[section for section in sections if section.panels],
        commands=[
            repeated("track", study.manifest, {"laws": study.vary["law"], "seeds": study.seeds}),
            *(
                [shlex.join(["nsaid", "view", str(folder / RECORDING)])]
                if installed("rerun")
                else []
            ),
        ],
        notes=["All figures are in tracking.json and tracking.csv."],
        versions=study.manifest["versions"],
    )
