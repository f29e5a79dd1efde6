"""Titles and commands on the pages of studies."""

import shlex

import pytest

from nsaid_mj.cli import grammar
from nsaid_mj.plans.studies.sweep_report import _command

MANIFEST = {"script": "ur5", "arguments": ["--duration", "4.0"], "runs": 6, "seeds": 3}


def test_a_sweeps_command_repeats_it():
    words = shlex.split(_command({**MANIFEST, "vary": {"identifier.gain": [0.1, 1.0]}}))
    assert words == [
        *("nsaid", "sweep", "ur5", "--duration", "4.0", "--seeds", "3"),
        *("--vary", "identifier.gain=0.1,1.0"),
    ]
    assert words[1] in grammar.COMMANDS


@pytest.mark.parametrize("shared", [True, False])
def test_a_monte_carlo_studys_command_repeats_it(shared: bool):
    command = _command({**MANIFEST, "vary": {}, "montecarlo": {"shared": shared}})
    assert command.startswith("nsaid montecarlo ur5 --duration 4.0 --runs 6")
    assert command.endswith("--own-plants") == (not shared)
