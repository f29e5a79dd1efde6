"""The common part of all studies: a scenario, its script, and the flags to repeat a run."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from .. import evaluation
from ..bounds import shown
from ..errors import InvalidInput
from ..experiment.library import digest_of
from ..experiment.scenario import Scenario

MOST_RUNS = 1_000_000
"""Largest number of runs of a study; a day has as many tenths of a second."""
MOST_JOBS = 1024
"""Largest number of runs at the same time."""


def check_count(name: str, number: int, remedy: str, most: int = MOST_RUNS) -> None:
    """Checks a number of runs, or of runs at the same time.

    Raises:
        InvalidInput: it is less than 1, or more than `most`.
    """
    if not 1 <= number <= most:
        raise InvalidInput(name, f"a number from 1 to {most}", shown(number), remedy)


@dataclass(frozen=True)
class Study:
    """A scenario that is run many times.

    Attributes:
        script: name of the packaged scenario, or path of its script.
        scenario: the scenario.
        arguments: flags of `nsaid run` that turn the script's scenario into this one.
    """

    script: str
    scenario: Scenario
    arguments: tuple[str, ...] = field(default=(), kw_only=True)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the script."""
        return digest_of(self.script)

    def manifest_of(self, **own: Any) -> dict[str, Any]:
        """The study's manifest: everything that its results depend on, as JSON values.

        Args:
            own: entries of the particular kind of study.
        """
        return {
            "script": self.script,
            "script_sha256": self.digest,
            "scenario": json.loads(self.scenario.to_json()),
            **own,
            "versions": evaluation.versions(),
            "arguments": list(self.arguments),
        }
