"""The common part of all studies: a scenario, its script, and the flags to repeat a run."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from .. import evaluation
from ..experiment.library import digest_of
from ..experiment.scenario import Scenario


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
