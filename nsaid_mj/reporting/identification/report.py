"""report.html of an identification: verdict, predictions, parameters, and what is not known."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ... import __version__
from ...calibration import words
from ...calibration.result import Identification, Parameter
from ...resources import write_text
from .. import pages

FILE = "report.html"
_OPEN = 12  # parameters in total, up to which no table is collapsed


def write(result: Identification, folder: Path, command: str = "") -> Path:
    """Writes report.html atomically and returns its path.

    Args:
        result: of an identification.
        folder: an existing folder.
        command: command line that was run, for the page; "" to name model and logs only.
    """
    path = folder / FILE
    write_text(path, page(result, command))
    return path


def page(result: Identification, command: str = "") -> str:
    """The report as HTML; see `write`."""
    from . import figures, picture  # imported late: matplotlib takes half a second

    sketch = picture.picture(result)
    drawn, checked = figures.commands(result), figures.commands(result, validation=True)
    return pages.render(
        "identification.html",
        eyebrow="identification from logs",
        heading=result.robot.name,
        lead=_lead(result),
        rows=words.rows_of(result),
        verdict=pages.verdict(
            words.EXPLAINS[result.explains].kind,
            result.verdict,
            words.EXPLAINS[result.explains].glyph,
        ),
        alarms=_findings(result, ("refusal", "warning")),
        notes=_findings(result, ("note",)),
        counts=_counts(result.parameters),
        carrying=[f for f in (figures.joints(result), sketch) if f is not None],
        joints=_joints(result),
        commands=drawn,
        validation=checked,
        cutoff=words.number(result.cutoff),
        gains=figures.forests(result, gains=True),
        gain_rows=[_row(p, result) for p in result.parameters if words.is_gain(p)],
        frictions=figures.forests(result, gains=False),
        combinations=_combinations(result),
        blocks=_blocks(result),
        unknown=[(_status(status), names) for status, names in words.unknown_in_words(result)],
        suggestion=_code(result.suggestion),
        anchor=_code(result.anchor),
        correlations=figures.correlations(result),
        law=_law(result),
        histories=figures.histories(result),
        again=pages.again(
            [command or _command(result)],
            {"nsaid-mj": __version__, "Python": platform.python_version()},
        ),
    )


def _lead(result: Identification) -> str:
    n, p = len(result.joints), len(result.parameters)
    return (
        f"{n} {words.rows_of(result)[n != 1]}, {p} parameters; {words.logs_in_words(result)}; "
        f"identified in {result.seconds:.1f} s."
    )


def _findings(result: Identification, levels: Sequence[str]) -> list[dict[str, str]]:
    return [
        pages.alarm(
            f"{f.where + ': ' if f.where else ''}{f.text}. {f.remedy}",
            words.LEVELS[f.level].kind,
            f.level,
            words.LEVELS[f.level].glyph,
        )
        for f in result.findings
        if f.level in levels
    ]


def _status(status: str, count: str = "") -> dict[str, str]:
    mark = words.STATUSES[status]
    return pages.mark(mark.kind, f"{count}{status}", mark.glyph)


def _counts(parameters: Iterable[Parameter]) -> list[dict[str, str]]:
    """A badge for each status, with the number of parameters that have it."""
    return [_status(status, f"{count} ") for status, count in words.counts(parameters)]


def _joints(result: Identification) -> dict[str, Any]:
    """Table of the prediction's quality and the chosen structure, per joint."""
    checked = any(j.validation is not None for j in result.joints)
    heads = [words.rows_of(result)[0], "fit", "held out", "least squares"]
    heads += ["validation", "least squares"] * checked
    heads += ["columns", "s [rad/s, m/s]", "delay"]
    lines = []
    for j in result.joints:
        line = [j.name, *(words.nrmse(x) for x in (j.fit, j.held_out, j.least_squares))]
        if checked:
            line += [words.nrmse(j.validation), words.nrmse(j.validation_least_squares)]
        speed = words.number(j.friction_speed)
        lines.append([*line, ", ".join(j.columns), speed, words.delay(j.delay)])
    return {"heads": heads, "lines": lines, "text": [0, 6 if checked else 4]}


def _row(parameter: Parameter, result: Identification) -> dict[str, Any]:
    """A parameter for its table; combinations are referred to by their numbers."""
    value, interval = words.estimate(parameter.value, parameter.low, parameter.high)
    known = [c.words for c in result.combinations]
    number = known.index(parameter.combination) + 1 if parameter.combination in known else 0
    return {
        "label": parameter.label,
        "value": value,
        "interval": words.ABSENT if parameter.status == "known" else interval,
        "unit": parameter.unit,
        "prior": words.number(parameter.prior),
        "status": _status(parameter.status),
        "number": number,
        "words": _words(parameter) if not number else "",
    }


def _words(parameter: Parameter) -> str:
    """The combination a parameter is known in, and a gain's interval apart from the scale."""
    apart = f"{words.relative(parameter)} of the other gains" if parameter.relative else ""
    return "; ".join(filter(None, (parameter.combination, apart)))


def _combinations(result: Identification) -> list[dict[str, Any]]:
    found = []
    for combination in result.combinations:
        value, interval = words.estimate(combination.value, combination.low, combination.high)
        found.append(
            {"words": combination.words, "value": value, "interval": interval,
             "unit": combination.unit}
        )  # fmt: skip
    return found


def _law(result: Identification) -> dict[str, Any] | None:
    """Gains and predictions of a law beside the batch fit's, for tables."""
    along = result.law
    if along is None:
        return None
    names = [j.name for j in result.joints]
    return {
        "name": along.name,
        "gains": words.law_gains(along),
        "last": [
            [name, words.nrmse(own), words.nrmse(batch)]
            for name, own, batch in zip(names, along.last, along.batch_last, strict=True)
        ],
        "page": f"{along.name}/report.html",
    }


def _blocks(result: Identification) -> list[dict[str, Any]]:
    """A table for each block of θ, with the number of parameters of each status."""
    blocks: dict[str, list[Parameter]] = {}
    for parameter in result.parameters:
        blocks.setdefault(parameter.block, []).append(parameter)
    inertial = words.links(result.parameters)
    return [
        {
            "name": words.of_joint(members[0]) if name in inertial else name,
            "open": len(result.parameters) <= _OPEN,
            "counts": _counts(members),
            "rows": [_row(p, result) for p in members],
        }
        for name, members in blocks.items()
    ]


def _command(result: Identification) -> str:
    """Command line with the model and the logs, as far as the result knows them."""
    source = result.robot.source
    model = str(source) if source is not None else result.robot.name
    logs = list(dict.fromkeys(s.source for s in result.recordings.segments))
    return shlex.join(["nsaid", "identify", "--model", model, "--log", *logs])


def _code(text: str) -> list[tuple[bool, str]]:
    """(is code, text) of the parts of a sentence with `code` in backticks."""
    return [(bool(k % 2), part) for k, part in enumerate(text.split("`")) if part]
