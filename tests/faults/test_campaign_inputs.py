"""A few tries of the campaign's families that need one process; `python -m scripts.campaign`."""

import sys

import pytest

from tests import campaign
from tests.campaign import commands, files, tries
from tests.support.faulty import shell

FEW = {"urdfs": 80, "commands": 12, "scripts": 8, "logs": 6, "fields": 40, "MJCF files": 40}
FEW |= {"vehicles' sheets": 40}
SEED = {"commands": 4}  # of seed 1, a whole run of 18 s is among the first twelve


def failed(family: str, count: int, seed: int) -> list[tries.Try]:
    made = list(campaign.carry_out(family, count, seed))
    assert len(made) == count
    return [found for found in made if found.wrong]


@pytest.mark.parametrize("family", FEW)
def test_bad_input_never_ends_in_an_untyped_error(family):
    assert failed(family, FEW[family], SEED.get(family, 1)) == []


@pytest.mark.slow
@pytest.mark.parametrize("family", [*commands.FAMILIES, *files.FAMILIES])
def test_much_bad_input_never_ends_in_an_untyped_error(family):
    assert failed(family, 200 if family in FEW else 20, seed=2) == []


def test_the_campaign_notices_untyped_errors_hangs_and_silence(monkeypatch, tmp_path):
    def crash() -> str:
        raise TypeError("unorderable")

    def stay() -> str:
        while True:
            pass

    monkeypatch.setattr(tries, "LIMIT", 1)
    assert tries.wrong_with(crash) == "TypeError: unorderable (crash)"
    assert tries.wrong_with(stay) == "longer than 1 s"
    monkeypatch.setattr("nsaid_mj.cli.commands.run_from_shell", lambda: sys.exit(2))
    assert tries.nsaid(["run"], tmp_path).wrong == "refused without a word"


def test_a_folder_whose_name_looks_like_markup_is_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    short = ("--duration", "0.05", "--held-out", "0.05", "--pe-window", "0.02")
    code, said = shell("run", "scalar_rov", *short, "--out", "[/x]")
    assert code == 0 and "[/x]" in said.out
    assert (tmp_path / "[" / "x]" / "summary.json").is_file()


@pytest.mark.parametrize(
    "words",
    [
        ("montecarlo", "scalar_rov", "--runs", "1000000000000"),
        ("montecarlo", "scalar_rov", "--jobs", "100000"),
        ("sweep", "scalar_rov", "--seeds", "1000000000000"),
        ("sweep", "scalar_rov", "--vary", "identifier.gain=nan"),
        ("compare", "scalar_rov", "--seeds", "0:1000000000000"),
        ("compare", "scalar_rov", "--durations", "1e12"),
        ("run", "scalar_rov", "--dt", "1e-12"),
        ("run", "scalar_rov", "--held-out", "1e12"),
        ("run", "scalar_rov", "--mismatch.delay", "1e12"),
        ("run", "scalar_rov", "--tones", "2147483648"),
        ("run", "ur5", "--harmonics", "9223372036854775808"),
        ("run", "scalar_rov", "--block", "1e300"),
        ("run", "scalar_rov", "--pe-window", "1e300"),
        ("run", "scalar_rov", "--amplitude", "1e300"),
        ("run", "scalar_rov", "--initial-error", "1e300"),
    ],
)
def test_numbers_beyond_memory_are_refused_before_anything_is_written(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, said = shell(*words)
    assert code == 2 and "expected" in said.err and not list(tmp_path.iterdir())
