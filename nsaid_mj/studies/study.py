"""What every study is made of: a scenario, where it comes from, and how to repeat it."""

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
        script: the scenario's packed name, or its script's path.
        scenario: what is run.
        arguments: flags of `nsaid run` that made the scenario, to repeat a run.
    """

    script: str
    scenario: Scenario
    arguments: tuple[str, ...] = field(default=(), kw_only=True)

    @cached_property
    def digest(self) -> str:
        """Of the script's text."""
        return digest_of(self.script)

    def manifest_of(self, **own: Any) -> dict[str, Any]:
        """What the results depend on, and what a reader needs to know of them; JSON.

        Args:
            own: what the kind of study adds.
        """
        return {
            "script": self.script,
            "script_sha256": self.digest,
            "scenario": json.loads(self.scenario.to_json()),
            **own,
            "versions": evaluation.versions(),
            "arguments": list(self.arguments),
        }
