"""`nsaid excite`: designs a motion, writes and prints it; the work is in `design`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..base import InvalidInput, print_json, reading
from .checks import check_excite, two_noises
from .folders import folder_for_results
from .grammar import Excite
from .process import code_of

if TYPE_CHECKING:
    from ..lab import DriverConfig, Progress, Scenario

DESIGN = "design.json"


def excite(chosen: Excite) -> int:
    """Executes the command and returns the exit code."""
    if not chosen.scenario and chosen.model is None:
        remedy = "Such as `nsaid excite ur5` or `nsaid excite --model arm.urdf`."
        raise InvalidInput("excite", "a scenario or --model", "neither", remedy)
    check_excite(chosen)
    scenario = _scenario(chosen)
    path = Path(chosen.model or chosen.scenario)
    name = path.absolute().parent.name if path.name == "vehicle.toml" else path.stem
    with (
        reading(chosen.model, chosen.scenario, chosen.limits),
        folder_for_results(
            f"{name}-excite", chosen.out, chosen.force, DESIGN, "a design"
        ) as folder,
    ):
        return _designed_in(folder, name, scenario, chosen)


def _designed_in(folder: Path, name: str, scenario: Scenario, chosen: Excite) -> int:
    """Designs, and writes and prints the results."""
    from rich.console import Console

    from ..base import installed
    from ..lab import Progress
    from ..plans import (
        Experiment,
        Limits,
        own_limits,
        predict,
        read_limits,
        scenario_of,
        tried,
        write_design,
    )
    from ..plans import design as design_design
    from ..plans import design_document as files_document
    from ..plans import design_page as pages_page
    from ..plans import ranks as information_ranks
    from ..report import print_page, write_html

    def limited(own: Limits) -> Limits:
        """The limits of model and file; a real robot must not touch itself or the ground either."""
        if chosen.model is not None and not experiment.system.group:
            own = own_limits(experiment.system, own)
            own = replace(own, contacts=experiment.contacts is not None)
        return read_limits(chosen.limits, own) if chosen.limits else own

    with Progress(name, quiet=chosen.quiet or chosen.json) as progress:
        experiment = Experiment.of(scenario, chosen.seed)
        found = design_design(
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
        ranks = information_ranks(experiment, found.limits)
        written = write_design(found, predicted, ranks, scenario_of(found, scenario), folder)
        document = files_document(found, predicted, ranks, folder.name)
        progress.say("trying the experiment on a draw of the prior")
        trial = tried(found)
        page = pages_page(name, document, trial, found, folder)
        written.append(write_html(page, folder))
        if installed("rerun"):
            from ..plans import DESIGN_RECORDING, record_design

            written.append(record_design(page, found, folder / DESIGN_RECORDING))
    if chosen.json:
        print_json(document)
    elif not chosen.quiet:
        print_page(page, Console(highlight=False), written)
    return code_of(page.result)


def _scenario(chosen: Excite) -> Scenario:
    """The requested experiment, before it has a motion."""
    from ..lab import load

    if chosen.model is not None:
        from ..plans import scenario_of_model

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

    `checks.check_excitation` has accepted the value.
    """
    from ..lab import Scenario

    _, colon, folder = given.partition(":")
    if colon:
        return Scenario.from_json((Path(folder) / "scenario.json").read_bytes()).excitation
    from ..plans import Experiment
    from ..plans import design as design_design

    return design_design(Experiment.of(scenario), report=progress.stage).driver
