"""The only reader of summary.json, which `RunResult.summary` makes.

A topic of statistics is a stretch of the file: its fields are the keys, in their order.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, replace
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from ...base import InvalidInput
from ...core import FaultEvent, ParameterSpace
from .run_result import RunResult, judged
from .statistics import (
    OPTIONAL,
    Accuracy,
    Conditions,
    Definiteness,
    Dimensions,
    Estimated,
    Excitation,
    LawUsed,
    Origin,
    RivalStatistics,
    RunCost,
    RunEnding,
    StatedConfidence,
    Theory,
    Unobservable,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from ...watch import Misfit

SUMMARY_FILE = "summary.json"

# -- the reader ------------------------------------------------------------------------------------

_REMEDY = "Delete the file: `nsaid view --rebuild` then makes it again from the record."


def result_from(
    found: Any, space: ParameterSpace | None = None, name: str = SUMMARY_FILE
) -> RunResult:
    """The result, without curves, whose `summary` is a value of JSON.

    Args:
        found: the content of a summary.json.
        space: the parameters; without it, those of the result have no blocks.
        name: name of the file, for errors.

    Raises:
        InvalidInput: it is not a run's summary; the error names the first value that is missing or
            of a wrong type.
    """
    if not isinstance(found, dict):
        raise InvalidInput(name, "an object with the keys of a run's summary", found, _REMEDY)
    read = _Reader(found, name)
    recorded = "parameters" in found
    result = RunResult(
        truth_known="mismatch" in found,
        recorded=recorded,
        ending=read.topic(RunEnding),
        dimensions=read.topic(Dimensions),
        accuracy=read.topic(Accuracy),
        theory=read.topic(Theory),
        excitation=read.topic(Excitation),
        definiteness=read.topic(Definiteness),
        rivals=read.rivals(),
        misfit=read.misfit() if "misfit" in found else None,
        confidence=read.value("confidence", StatedConfidence | None),
        estimates=read.value("parameters", tuple[Estimated, ...]) if recorded else (),
        law=read.topic(LawUsed),
        conditions=read.topic(Conditions),
        faults=read.faults(),
        samples=read.value("stream", dict[str, int]) if "stream" in found else {},
        unobservable=read.value("unobservable", tuple[Unobservable, ...]),
        cost=read.topic(RunCost),
        origin=read.topic(Origin),
    )
    _check_names(result, name)
    return judged(result, space)


def _check_names(result: RunResult, name: str) -> None:
    """Checks that parts of a summary speak of each other.

    Raises:
        InvalidInput: the confidence names a parameter that is not in the list, or has no direction;
            or a motion contradicts the structure at no time.
    """
    misfit = result.misfit
    stated = result.confidence
    if misfit is not None and misfit.level == "contradicts" and not misfit.contradictions:
        where = f"{name}, misfit_contradictions"
        raise InvalidInput(where, "at least one time", "none", _REMEDY)
    if stated is None:
        return
    if not stated.worst_known:
        where = f"{name}, confidence.worst_known"
        raise InvalidInput(where, "at least one direction", "none", _REMEDY)
    correlations = stated.correlations
    known = result.labels
    sizes = [len(row) for row in correlations.lower]
    if sizes != list(range(len(correlations.parameters))):
        where = f"{name}, confidence.correlations"
        raise InvalidInput(where, "one more number in every row", sizes, _REMEDY)
    named = [*stated.actuators, *stated.parameters, *correlations.parameters]
    named += [parameter for one in stated.worst_known for parameter in one.parameters]
    for parameter in named:
        if parameter not in known:
            where = f"{name}, confidence"
            raise InvalidInput(where, "names of parameters", parameter, _REMEDY)


_Topic = TypeVar("_Topic", bound="DataclassInstance")


class _Reader:
    """Reads typed values from the content of a file.

    Args:
        found: its keys and values.
        name: its name, for errors.
    """

    def __init__(self, found: dict[str, Any], name: str):
        self._found = found
        self._name = name

    def topic(self, kind: type[_Topic]) -> _Topic:
        """The statistics of a topic, whose fields are keys of the file."""
        own = {f.name: self._found[f.name] for f in fields(kind) if f.name in self._found}
        return _with_undefined(self._checked(own, kind, ()), own)

    def rivals(self) -> dict[str, RivalStatistics]:
        """How good the last estimates of the other identifiers are."""
        found = self.value("rivals", dict[str, RivalStatistics])
        given = self._found["rivals"]
        return {name: _with_undefined(rival, given[name]) for name, rival in found.items()}

    def value(self, key: str, kind: Any) -> Any:
        """The value of a key, of a type."""
        if key not in self._found:
            raise self._error((key,), "a value", "none")
        return self._checked(self._found[key], kind, (key,))

    def misfit(self) -> Misfit:
        """The misfit of the structure, whose keys begin with `misfit`."""
        from ...watch import Misfit

        level = self._found["misfit"]
        if level not in Misfit.LEVELS:
            raise self._error(("misfit",), f"one of {', '.join(Misfit.LEVELS)}", level)
        return Misfit(
            level=level,
            contradictions=self.value("misfit_contradictions", tuple[float, ...]),
            innovations=self.value("misfit_innovations", float),
            seconds=self.value("misfit_seconds", float),
            chance=self.value("misfit_chance", float),
            widening=self.value("misfit_widening", float),
            drift=self.value("misfit_drift", float),
        )

    def faults(self) -> tuple[FaultEvent, ...]:
        """The faults that the law found."""
        found = self.value("faults", list[dict[str, Any]])
        try:
            return tuple(FaultEvent.of(keys) for keys in found)
        except (KeyError, TypeError, ValueError) as error:
            raise self._error(("faults",), "a list of faults", repr(error)) from error

    def _checked(self, value: Any, kind: Any, where: tuple[str, ...]) -> Any:
        """A value of JSON as a type; numbers are neither text nor true or false."""
        from pydantic import ValidationError

        try:
            return _adapter(kind).validate_json(json.dumps(value), strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            parts = (*where, *(str(part) for part in first["loc"]))
            if first["type"] == "missing":
                raise self._error(parts, "a value", "none") from error
            expected = first["msg"].removeprefix("Input should be ").replace("a valid ", "a ")
            raise self._error(parts, expected, first["input"]) from error

    def _error(self, where: tuple[str, ...], expected: str, got: object) -> InvalidInput:
        return InvalidInput(f"{self._name}, {'.'.join(where)}", expected, got, _REMEDY)


def _with_undefined(topic: Any, given: Mapping[str, Any]) -> Any:
    """Statistics of a topic, with NaN for those that may be left out but are null in the file."""
    undefined = {
        one.name: math.nan
        for one in fields(topic)
        if one.metadata.get(OPTIONAL) and one.name in given and given[one.name] is None
    }
    return replace(topic, **undefined)


@cache
def _adapter(kind: Any) -> Any:
    """Pydantic's validator of a type; its import takes a fifth of a second."""
    from pydantic import TypeAdapter

    return TypeAdapter(kind)
