"""The page of a design."""

import shlex
from pathlib import Path
from typing import Any

import numpy as np

from ...core import Array, number, rounded
from ...lab import INTERVAL, versions
from ...report import (
    Items,
    Page,
    PageItem,
    Result,
    Section,
    Statistic,
    Table,
    Text,
    count,
)
from ...report import Panel as Curves
from .designing import Design
from .limits import RANDOM
from .prediction import Trial

HALVES = ("half", "before")
_NONE = "–"  # no value; number of listed directions of P_s
_LISTED = 3
_INTERVALS = "At a fixed common scale. – means that motion does not reveal the parameter by itself."
_WEAK = (
    "The predicted standard deviation over that before the experiment; the weakest directions of "
    "the published values."
)
_HELP = "Deviations for the published values, each over that of the design."
_RATE = 30.0  # drawn rows of the motion per second
_SHOWN = 12  # numbers whose intervals a recording draws
_LEAST = 1e-12  # an error of 0 has no logarithm
_ALONE = 0.5  # share of a parameter that motion must reveal for its own interval to mean anything


def result_of(document: dict[str, Any], trial: Trial | None, found: Design) -> Result:
    """The result of a design, from it and its `design.files.document`.

    Its statistics are the predicted rms deviations of the requested numbers, relative to their
    sizes; its verdict is the improvement over random motions, and its curves show the `trial` on a
    draw of the prior.
    """
    own = document["predicted_deviation"]
    asked = document["asked"]
    squares = np.square(document["predicted_deviation_of_random_motions"])
    random = float(np.sqrt(np.mean(squares)))  # over draws like the design's
    sources = {limit["source"] for limit in document["limits"].values()}
    which = " of the same limits" if sources <= {RANDOM} else " of the usual size"
    which += ", which may collide" if document["contacts"] else ""
    if random > own:
        words = (
            f"Predicted rms deviation of the {asked}: {_percent(own)}, {random / own:.2g} times "
            f"smaller than with random motions{which} ({_percent(random)})."
        )
    else:
        words = (
            f"No better than random motions{which}: predicted rms deviation of the {asked} "
            f"{_percent(own)}, of random motions {_percent(random)}."
        )
    deviations = {"as designed": own, "random motions": random}
    return Result(
        explains="yes" if random > own else "partly",
        verdict=words,
        statistics=(Statistic(f"predicted rms deviation of the {asked}", "%", deviations),),
        curves=_curves(document, trial, found),
    )


def _percent(deviation: float) -> str:
    """A relative deviation with two digits."""
    return f"{number(float(f'{100 * deviation:.2g}'))} %"


def statements(document: dict[str, Any]) -> list[str]:
    """How much of θ the experiment determines, and how many harmonics that needs."""
    count = document["weak_directions"]
    needed = document["harmonics"]["dimension_of_P_perp"]
    lines = [
        f"{needed - count} of {needed} observable directions will be known, "
        + (f"{count} remain weak." if count else "none remains weak.")
    ]
    measured = [f"{rank} with {h}" for h, rank in document["harmonics"]["measured"]]
    if measured:
        lines.append(f"Excited directions by number of harmonics: {', '.join(measured)}.")
    return lines


def _unobservable(document: dict[str, Any]) -> list[str | tuple[str, str]]:
    """Directions that no motion reveals, the first ones, with what one known number fixes."""
    every = document["unobservable"]
    more = len(every) - _LISTED
    last = [f"In design.json: {count(more, 'more such direction')}."] if more > 0 else []
    return [*((words, f"{fix}.") for words, fix in every[:_LISTED]), *last]


def _weak_rows(document: dict[str, Any]) -> list[list[str]]:
    """Weak directions, the share of their deviation that stays, the best remedy, and its share."""
    return [
        [
            direction["words"],
            f"{100 * direction['left']:.0f} %",
            direction["remedy"] or "no remedy helps",
            f"{100 * direction['after']:.2g} %" if direction["remedy"] else _NONE,
        ]
        for direction in document["weak"]
    ]


def _remedy_rows(document: dict[str, Any]) -> list[list[str]]:
    """Other experiments, their deviation over the design's, and the weak directions they leave."""
    own = document["predicted_deviation_of_prior"]
    return [
        [other["words"], rounded(other["predicted"] / own, 2), str(other["weak"])]
        for other in document["remedies"]
    ]


def design_page(
    robot: str, document: dict[str, Any], trial: Trial | None, found: Design, folder: Path
) -> Page:
    """The page of a design in a folder; the arguments are those of `result_of`."""
    from ...report import figures_of

    result = result_of(document, trial, found)
    weak = _weak_rows(document)
    determined: list[PageItem] = [Items(statements(document))]
    if weak:
        heads = ["weak direction", "deviation left", "best remedy", "left then"]
        determined += [Table(heads, weak, (0, 2)), Text(_WEAK, note=True)]
    designed = ["as designed", "1", str(document["weak_directions"])]
    heads = ["experiment", "deviation over the design's", "weak directions"]
    helps = Table(heads, [designed, *_remedy_rows(document)])
    return Page(
        heading=robot,
        result=result,
        eyebrow=f"design of an experiment · {folder.name}",
        lead=f"{document['duration']:g} s of motion for {document['asked']}, before anything "
        "moves.",
        carrying=figures_of([p for p in result.curves if isinstance(p, Curves) and p.page]),
        sections=[
            Section("What the experiment will determine", determined, brief=True),
            Section("What would help", [helps, Text(_HELP)], brief=True),
            Section("What no motion reveals", [Items(_unobservable(document))], brief=True),
            Section(
                "Predicted 95 % intervals",
                [
                    _intervals(document),
                    Text(_INTERVALS),
                    Text(
                        "Root mean squares over draws of the prior; all parameters are in "
                        "design.json.",
                        note=True,
                    ),
                ],
                brief=True,
            ),
            Section("Limits", [_limits(document)], brief=True),
        ],
        commands=[f"nsaid run {shlex.quote(str(folder / 'scenario.py'))}"],
        notes=[
            "motion.csv is the motion; scenario.py makes it in MuJoCo; all figures are in "
            "design.json."
        ],
        versions=versions(),
    )


def _curves(document: dict[str, Any], trial: Trial | None, found: Design) -> tuple[Curves, ...]:
    """The trial's largest deviations and errors over time; then, for recordings, those of numbers.

    Also for recordings: velocities and commands of the motion.
    """
    motion = _motion(found)
    if trial is None:
        return motion
    title = f"Predicted and reached: {document['asked']}"
    panel = Curves(title, "largest relative error [–]", True)
    sides = _sides(trial)
    for label, values in sides.items():
        panel.add(trial.t, values.max(axis=1), label)
    space = found.experiment.system.space
    names = found.asked.names
    single = []
    for k in np.argsort(-trial.predicted[-1])[:_SHOWN].tolist():
        title = space.labels[space.index(names[k])]
        key = ("interval", names[k])
        own = Curves(title, "relative error [–]", True, key=key, page=False)
        values = np.maximum(np.column_stack([side[:, k] for side in sides.values()]), _LEAST)
        own.add_columns(trial.t, values, list(sides))
        single.append(own)
    return (panel, *single, *motion)


def _sides(trial: Trial) -> dict[str, Array]:
    """What is compared over time, by name."""
    return {
        "predicted 95 %": INTERVAL * trial.predicted,
        "stated by the law, 95 %": INTERVAL * trial.stated,
        "error in the trial": trial.error,
    }


def _motion(found: Design) -> tuple[Curves, Curves]:
    """Velocities and commands of the motion, for recordings."""
    log = found.logs[0]
    system = found.experiment.system
    every = max(1, round(1 / (_RATE * found.experiment.scenario.dt)))
    t, _, v, u = (part[::every] for part in log)
    velocity = Curves("Velocities", "v [SI]", key=("motion", "velocity"), page=False)
    velocity.add_columns(t, v, system.velocity_names)
    command = Curves("Commands", "u [–]", key=("motion", "command"), page=False)
    command.add_columns(t, u, system.command_names)
    return velocity, command


def _intervals(document: dict[str, Any]) -> Table:
    """The predicted intervals of gains, masses and frictions."""
    lines = [
        [
            row["label"],
            number(float(f"{row['value']:.3g}")),
            *(
                number(float(f"{row[half]:.2g}")) if row["observable"] > _ALONE else _NONE
                for half in HALVES
            ),
            row["unit"],
        ]
        for row in shown(document)
    ]
    return Table(["parameter", "prior", "±", "before ±", "unit"], lines, (0, 4))


def shown(document: dict[str, Any]) -> list[dict[str, Any]]:
    """The intervals of gains, masses and frictions; all others are in design.json."""
    words = ("gain", "friction", "drag", "lift", "thrust")
    return [
        row
        for row in document["intervals"]
        if row["label"].startswith("mass") or any(word in row["kind"] for word in words)
    ]


def _limits(document: dict[str, Any]) -> Table:
    """The limits, and the simulated motions' use of them."""
    lines = [
        [
            name,
            f"{np.max(np.abs([limit['low'], limit['high']])):.3g}",
            limit["unit"],
            f"{100 * document['uses'][name]:.0f} %",
            limit["source"],
        ]
        for name, limit in document["limits"].items()
    ]
    return Table(["limit", "largest", "unit", "use in simulation", "from"], lines, (0, 2, 4))
