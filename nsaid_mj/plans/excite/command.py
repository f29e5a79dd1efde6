"""`nsaid excite`: designs a motion, writes and prints it; the work is in `designing`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from ...base import CHOICES, InputFile, InvalidInput, path_of, print_json
from ...lab import ResultsFolder
from ...report import ExitCode
from ...robots import check_model
from .limits_file import read_limits_file

if TYPE_CHECKING:
    from ...lab import DriverConfig, Progress, Scenario

FILES = (
    *("design.json", "motion.csv", "scenario.json", "scenario.py"),
    *("report.html", "design.rrd"),
)
"""Files that `nsaid excite` writes; the first marks a folder of a design."""


class ToDesign(Protocol):
    """What `nsaid excite` was given; `cli.grammar` declares the flags."""

    scenario: str
    model: str | None
    duration: float
    want: str
    limits: Path | None
    criterion: str
    noise: str | None
    seed: int
    effort: float
    out: Path | None
    force: bool
    json: bool
    quiet: bool


def design_experiment(chosen: ToDesign) -> int:
    """Executes `nsaid excite` and returns the exit code."""
    if not chosen.scenario and chosen.model is None:
        remedy = "Such as `nsaid excite ur5` or `nsaid excite --model arm.urdf`."
        raise InvalidInput("excite", "a scenario or --model", "neither", remedy)
    check_excite(chosen)
    scenario = _scenario(chosen)
    path = Path(chosen.model or chosen.scenario)
    name = path.absolute().parent.name if path.name == "vehicle.toml" else path.stem
    own = ResultsFolder(chosen.out, chosen.force).of_results(f"{name}-excite", FILES, "a design")
    with own as folder:
        return _designed_in(folder, name, scenario, chosen)


def _designed_in(folder: Path, name: str, scenario: Scenario, chosen: ToDesign) -> int:
    """Designs, and writes and prints the results."""
    from rich.console import Console

    from ...base import installed
    from ...lab import Progress
    from ...report import print_page
    from .designing import design
    from .experiment import Experiment, own_limits
    from .files import design_document, scenario_of, write_design
    from .information import ranks
    from .limits import Limits, read_limits
    from .page import design_page
    from .prediction import predict, tried

    def limited(own: Limits) -> Limits:
        """The limits of model and file; a real robot must not touch itself or the ground either."""
        if chosen.model is not None and not experiment.system.group:
            own = own_limits(experiment.system, own)
            own = replace(own, contacts=experiment.contacts is not None)
        return read_limits(chosen.limits, own) if chosen.limits else own

    with Progress(name, quiet=chosen.quiet or chosen.json) as progress:
        experiment = Experiment.of(scenario, chosen.seed)
        found = design(
            experiment,
            wanted=chosen.want,
            criterion=chosen.criterion,
            limits=limited,
            seed=chosen.seed,
            effort=chosen.effort,
            report=progress.stage,
        )
        predicted = predict(found, progress.stage)
        progress.say("counting harmonics")
        counted = ranks(experiment, found.limits)
        written = write_design(found, predicted, counted, scenario_of(found, scenario), folder)
        document = design_document(found, predicted, counted, folder.name)
        progress.say("trying the experiment on a draw of the prior")
        trial = tried(found)
        page = design_page(name, document, trial, found, folder)
        written.append(page.write_html(folder))
        if installed("rerun"):
            from .recording import DESIGN_RECORDING, record_design

            written.append(record_design(page, found, folder / DESIGN_RECORDING))
    if chosen.json:
        print_json(document)
    elif not chosen.quiet:
        print_page(page, Console(highlight=False), written)
    return ExitCode.of(page.result)


def _scenario(chosen: ToDesign) -> Scenario:
    """The requested experiment, before it has a motion."""
    from ...lab import load

    if chosen.model is not None:
        from .experiment import scenario_of_model

        found = scenario_of_model(chosen.model)
    else:
        found = load(chosen.scenario)
    found = replace(
        found, duration=chosen.duration, pe_window=min(found.pe_window, chosen.duration)
    )
    if chosen.noise is None:
        return found
    position, velocity = two_noises(chosen.noise)
    noise = replace(found.noise, position=position, velocity=velocity, encoder_step=0.0)
    return replace(found, noise=noise)


def designed(scenario: Scenario, given: str, progress: Progress) -> DriverConfig:
    """The excitation for `--excitation designed` or `--excitation designed:FOLDER`.

    `nsaid run` has accepted the value.
    """
    from ...lab import Scenario

    _, colon, folder = given.partition(":")
    if colon:
        return Scenario.from_json(InputFile(path_of(folder) / "scenario.json").read()).excitation
    from .designing import design
    from .experiment import Experiment

    return design(Experiment.of(scenario), report=progress.stage).driver


def two_noises(text: str) -> tuple[float, float]:
    """The standard deviations of `--noise`; raises `InvalidInput` unless they are two numbers."""
    try:
        position, velocity = (float(part) for part in text.split(","))
    except ValueError as error:
        expected = "two numbers, of position and velocity"
        raise InvalidInput("--noise", expected, text, "Such as 1e-4,5e-3.") from error
    return position, velocity


def check_excite(chosen: ToDesign) -> None:
    """Checks what `nsaid excite` was given, but the scenario's name."""
    CHOICES.check("criterion", chosen.criterion)
    if chosen.noise is not None:
        two_noises(chosen.noise)
    if chosen.limits is not None:
        read_limits_file(chosen.limits)
    if chosen.model is not None:
        check_model(chosen.model)
