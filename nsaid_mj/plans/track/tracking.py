"""`nsaid track`: tracking laws on the same plants and references, evaluated by true positions.

Every law gets the same prior, Λ, K_d and bandwidth of adaptation, and the same sensor noise.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base import CHOICES, Finding, InvalidInput, OutputFile, without_nonfinite
from ...core import Array, ConeMetric, Log, Status, rounded
from ...lab import (
    AdaptiveTracking,
    Driver,
    Following,
    Plant,
    Scenario,
    Setup,
    Tracker,
    Truth,
)
from ...report import LAWS as COLOUR_OF
from ...report import (
    Explains,
    Panel,
    Result,
    Statistic,
    Table,
    count,
    spread,
)
from ..studies.study import Study, write_csv
from .evaluation import ControlledMotion, figures, lyapunov_rises

TRACKING_FILES = ("tracking.json", "tracking.csv")
_POINTS = 4000  # of a command over time, at most
_LAST = 1 / 3  # of the duration, over which rms errors are taken


def tracking_plan(
    script: str,
    scenario: Scenario,
    laws: tuple[str, ...] = CHOICES["tracking law"],
    seeds: tuple[int, ...] = tuple(range(10)),
    arguments: tuple[str, ...] = (),
) -> Study:
    """The laws of a study, and the plants they control.

    Args:
        script: name of the packaged scenario, or path of its script.
        scenario: with the excitation `AdaptiveTracking`; every law in turn replaces its law.
        laws: names.
        seeds: seeds of truth, prior, reference and sensors.
        arguments: flags of `nsaid run` that turn the script's scenario into this one.

    Raises:
        UnknownName: a law is unknown.
        InvalidInput: the scenario's excitation does not track, or there are no seeds.
    """
    for law in laws:
        CHOICES.check("tracking law", law)
    if not laws or not seeds:
        raise InvalidInput("--laws, --seeds", "at least one of each", "none", "Leave them out.")
    if not isinstance(scenario.excitation, AdaptiveTracking):
        raise InvalidInput(
            "scenario",
            "one that is driven by AdaptiveTracking",
            f"{script}, driven by {type(scenario.excitation).__name__}",
            "Use track_ur5, track_bluerov2 or track_uvms, or write one.",
        )
    settings = {
        "laws": list(laws),
        "seeds": list(seeds),
        "last_seconds": scenario.duration * _LAST,  # over which errors are taken
    }
    return Study(script, scenario, {"law": laws}, seeds, settings, arguments)


@dataclass(frozen=True, eq=False)
class TrackedCourse:
    """A law on one plant.

    Attributes:
        seed: seed of plant, prior, reference and sensors.
        figures: figures of `evaluation.tracking.figures`; with exact sensors also `v_rises`, the
            number of steps in which V rose beyond its bound, for the law with the proof.
    """

    law: str
    seed: int
    figures: dict[str, float | str]
    motion: ControlledMotion
    setup: Setup
    tracker: Tracker


def courses(
    study: Study, report: Callable[[str], object] = lambda _: None
) -> Iterator[TrackedCourse]:
    """Runs every law on the plant of every seed; `report` receives each stage."""
    for seed in study.seeds:
        scenario = replace(study.scenario, seed=seed)
        base = Setup.of(scenario)
        for law in study.vary["law"]:
            report(f"seed {seed}, {law}")
            assert isinstance(scenario.excitation, AdaptiveTracking)
            own = replace(scenario, excitation=replace(scenario.excitation, law=law))
            yield course(replace(base, scenario=own), study.settings["last_seconds"])


def course(setup: Setup, last: float) -> TrackedCourse:
    """Runs a scenario that is driven by `AdaptiveTracking`, with errors over its last seconds."""
    scenario = setup.scenario
    tracker = setup.driver()
    assert isinstance(scenario.excitation, AdaptiveTracking)
    assert isinstance(tracker, Tracker)
    motion = drive(setup, tracker)
    found = figures(motion, setup.system, tracker, last)
    metric = tracker.metric
    if isinstance(metric, ConeMetric) and scenario.sensors == "ideal":
        rises, largest = lyapunov_rises(motion, Truth(setup, scenario.duration), tracker, metric)
        found |= {"v_rises": rises, "v_largest_rise": largest}
    return TrackedCourse(scenario.excitation.law, scenario.seed, found, motion, setup, tracker)


def drive(setup: Setup, tracker: Tracker) -> ControlledMotion:
    """Drives the plant; an informed law gets the estimates of the scenario's identifier."""
    scenario = setup.scenario
    plant = setup.plant
    sensors = setup.sensors()
    recorder = _StateRecorder(tracker, plant)
    every = int(min(tracker.steps(scenario.dt), scenario.steps))
    informed = np.isfinite(tracker.period)
    k = 0
    with plant.running():
        log = Log.unchecked_of([plant.begin(recorder, sensors)])
        logs = [log]
        following = Following(setup.identifiers()[""], log) if informed else None
        while k < scenario.steps:
            log = plant.drive(recorder, log.at(-1), min(every, scenario.steps - k), sensors)
            k += len(log.t) - 1
            logs.append(log.part(1, len(log.t)))
            if plant.diverged or not np.isfinite(log.v[-1]).all():
                break
            if following is not None and following.ended is None:
                following.follow(log, np.zeros(0, dtype=np.intp))
                if following.state.status is Status.completed:
                    tracker.inform(following.state.theta_hat)
        status = plant.diverged and f"plant diverged ({plant.diverged})"
    t, _, _, u = (np.concatenate(parts) for parts in zip(*logs, strict=True))
    numbers, v, theta_hat = (np.array(part) for part in zip(*recorder.rows, strict=True))
    q = plant.position(numbers)
    aims = plant.position(np.array([tracker.reference.desired(now)[0] for now in t.tolist()]))
    pairs = zip(q, aims, strict=True)
    error = np.array([setup.system.difference(own, aim) for own, aim in pairs])
    return ControlledMotion(t, q, v, u, theta_hat, error, status or "")


class _StateRecorder(Driver):
    """Records the plant's true state and the controller's estimate at every command."""

    def __init__(self, tracker: Tracker, plant: Plant):
        self._tracker = tracker
        self._plant = plant
        self.rows: list[tuple[Array, Array, Array]] = []

    def start(self) -> tuple[Array, Array]:
        return self._tracker.start()

    def command(self, t: float, q: Array, v: Array) -> Array:
        u = self._tracker.command(t, q, v)
        numbers, true_v = self._plant.coordinates()
        self.rows.append((np.array(numbers), np.array(true_v), self._tracker.theta_hat.copy()))
        return u


# -- output ----------------------------------------------------------------------------------------


def write(folder: Path, study: Study, done: list[TrackedCourse]) -> None:
    """Writes tracking.json, with the plan, and tracking.csv, one row for every law and seed.

    Raises:
        NotWritten: the folder cannot be written.
    """
    rows = [{"law": c.law, "seed": c.seed} | c.figures for c in done]
    heads = list(dict.fromkeys(key for row in rows for key in row))
    found = {"medians": medians(study, done), "rows": without_nonfinite(rows)}
    OutputFile(folder / TRACKING_FILES[0]).write_json(study.manifest | found)
    write_csv(folder / TRACKING_FILES[1], heads, rows)


def medians(study: Study, done: list[TrackedCourse]) -> dict[str, dict[str, float]]:
    """Medians over the seeds of every law's figures; `v_rises` is the sum."""
    found: dict[str, dict[str, float]] = {law: {} for law in study.vary["law"]}
    for law in study.vary["law"]:
        rows = [c.figures for c in done if c.law == law]
        for key in (key for key in (rows[0] if rows else ()) if key != "status"):
            values = np.array([float(row[key]) for row in rows])
            middle = float(values.sum() if key == "v_rises" else np.median(values))
            if np.isfinite(middle):
                found[law][key] = middle
    return found


_ERROR = "error"  # the name of the figure that compares with the conventional law


def figures_of(study: Study, done: list[TrackedCourse]) -> tuple[Statistic, ...]:
    """The figures of every law that has run.

    Medians over the seeds of rms and peak errors, of the conventional law's rms error over the
    law's own, and of the share of samples at a limit; the largest command over its limit; and the
    number of rises of V. A figure that a law lacks is None.
    """
    laws = {law: [c.figures for c in done if c.law == law] for law in study.vary["law"]}
    laws = {law: rows for law, rows in laws.items() if rows}

    def of(key: str, merge: Callable[[Array], Any]) -> dict[str, float | None]:
        return {
            law: float(merge(np.array([float(row[key]) for row in rows])))
            if key in rows[0]
            else None
            for law, rows in laws.items()
        }

    def ratio(key: str) -> dict[str, float | None]:
        known = [float(row[key]) for row in laws.get("conventional", ())]
        others = laws.keys() - {"conventional"} if known else ()
        pairs = {law: zip(known, laws[law], strict=False) for law in laws if law in others}
        return {
            law: float(np.median([a / float(row[key]) for a, row in own]))
            for law, own in pairs.items()
        }

    found = []
    for unit in (u for u in ("rad", "m") if any(f"rms_{u}" in rows[0] for rows in laws.values())):
        found += [
            Statistic("rms", unit, of(f"rms_{unit}", np.median), of(f"rms_{unit}", np.max)),
            Statistic(_ERROR, "", ratio(f"rms_{unit}")),
            Statistic("peak", unit, of(f"peak_{unit}", np.median)),
        ]
    return (
        *found,
        Statistic("effort", "%", of("effort", np.max)),
        Statistic("at limit", "%", of("saturated", np.median)),
        Statistic("V rises", "", of("v_rises", np.sum)),
    )


def table_of(study: Study, figures: Sequence[Statistic]) -> Table:
    """The table of such figures: a line for each law, with the worst seed's in brackets."""
    heads = [f"{f.name} [m{f.unit}]" if f.unit in {"rad", "m"} else f.name for f in figures]
    several = len(study.seeds) > 1
    ran = figures[-1].values
    lines = [[law, *(_cell(figure, law, several) for figure in figures)] for law in ran]
    spare = [k for k, f in enumerate(figures, 1) if f.name in {"peak", "effort", "at limit"}]
    return Table(["law", *heads], lines, spare=spare)


def _cell(figure: Statistic, law: str, several: bool) -> str:
    value, worst = (of.get(law) for of in (figure.values, figure.worst))
    if value is None:
        return "" if figure.name == _ERROR else "–"
    if figure.name == _ERROR:
        return _compared(value)
    if figure.unit == "%":
        return f"{rounded(100 * value, 2)} %"
    if not figure.unit:
        return f"{value:.0f}"
    brackets = f" ({_digits(1e3 * worst)})" if worst is not None and several else ""
    return _digits(1e3 * value) + brackets


def result_of(study: Study, done: list[TrackedCourse]) -> Result:
    """The result of a study: figures of every law, and errors over time.

    The verdict is how much better each adaptive law tracks than the conventional law.
    """
    figures = figures_of(study, done)
    compared = next((f.values for f in figures if f.name == _ERROR), {})
    ratios = {law: r for law in ("nullspace", "composite") if (r := compared.get(law)) is not None}
    said = ", ".join(f"{law} {_compared(ratio)}" for law, ratio in ratios.items())
    missing = len(study.vary["law"]) * len(study.seeds) - len(done)
    findings = [
        Finding("refusal", "early", f"seed {c.seed}, {c.law}", str(c.figures["status"]))
        for c in done
        if c.figures["status"] != "completed"
    ]
    if missing:
        text = f"{count(missing, 'run')} {'is' if missing == 1 else 'are'} missing"
        findings.append(Finding("refusal", "missing", "not finished", text))
    shown = [c for c in done if c.seed == done[0].seed]
    units = [f.unit for f in figures if f.name == "rms"]
    better: Explains = "yes" if all(ratio >= 1 for ratio in ratios.values()) else "partly"
    return Result(
        explains=better if ratios else None,
        verdict=f"Tracking error (rms) compared with the conventional law's: {said}.",
        statistics=figures,
        curves=(*(_errors(shown, unit) for unit in units), *map(_commands, shown)),
        findings=tuple(findings),
        complete=not findings,
    )


def medians_in_words(study: Study) -> str:
    """Explains the figures of the table."""
    several = len(study.seeds) > 1
    whose = f"Medians over {len(study.seeds)} seeds, worst in brackets, of" if several else "Of"
    return (
        f"{whose} the last {study.settings['last_seconds']:.3g} s, from true positions; "
        f"{study.scenario.sensors} sensors. "
        "Effort: peak command, in % of its limit; at limit: share of the time at the limit."
    )


def _errors(shown: list[TrackedCourse], unit: str) -> Panel:
    """Every law's error over time, in the unit of some coordinates."""
    faults = shown[0].setup.plant.faults
    events = [t for fault in faults for t in (fault.time, fault.until) if t is not None]
    title = f"Tracking error [{unit}]"
    label = f"rms error [{unit}]"
    key = ("error", unit)
    panel = Panel(title, label, True, events=events, key=key)
    for c in shown:
        error = c.motion.error_of(c.setup.system, unit)
        panel.add_rms(c.motion.t, error, c.law, COLOUR_OF[c.law], part=(c.law,))
    return panel


def _commands(course: TrackedCourse) -> Panel:
    """A law's commands over their limits, for recordings."""
    motion = course.motion
    low, high = course.tracker.limits
    rows = spread(len(motion.t), _POINTS)
    shares = motion.u / np.where(motion.u < 0, -low, high)
    title = f"{course.law}: commands over their limits"
    panel = Panel(title, "u [–]", key=("command", course.law), page=False)
    panel.add_columns(motion.t[rows], shares[rows], course.setup.system.command_names)
    return panel


def _compared(ratio: float) -> str:
    """The conventional law's error over another's, in words."""
    if ratio >= 1:
        return f"{_digits(ratio)} × smaller"
    return f"{_digits(1 / ratio if ratio > 0 else np.inf)} × larger"


def _digits(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"
