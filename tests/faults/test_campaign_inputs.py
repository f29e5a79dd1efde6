"""A few tries of every family of bad input; `python -m scripts.campaign_inputs` makes thousands."""

import sys

import pytest

from scripts import campaign_inputs, campaign_models, campaign_user
from tests.support.faulty import shell

FEW = {"urdfs": 80, "commands": 12, "scripts": 8, "logs": 6, "fields": 40}


def failed(family: str, tries: int, seed: int) -> list[campaign_inputs.Try]:
    made = list(campaign_inputs.carry_out(family, tries, seed))
    assert len(made) == tries
    return [found for found in made if found.outcome not in campaign_inputs.TYPED]


@pytest.mark.parametrize("family", FEW)
def test_bad_input_never_ends_in_an_untyped_error(family):
    assert failed(family, FEW[family], seed=1) == []


@pytest.mark.slow
@pytest.mark.parametrize("family", campaign_inputs.FAMILIES)
def test_much_bad_input_never_ends_in_an_untyped_error(family):
    assert failed(family, 200, seed=2) == []


def test_the_campaign_notices_untyped_errors_hangs_and_silence(monkeypatch):
    def crash() -> str:
        raise TypeError("unorderable")

    def stay() -> str:
        while True:
            pass

    monkeypatch.setattr(campaign_inputs, "LIMIT", 1)
    assert campaign_inputs.judged(crash) == ("untyped", "TypeError: unorderable (crash)")
    assert campaign_inputs.judged(stay)[0] == "hang"
    monkeypatch.setattr(campaign_inputs.cli, "run_from_shell", lambda: sys.exit(2))
    assert campaign_inputs.shell("run") == "untyped"  # refused without a word


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


@pytest.mark.parametrize("family", campaign_models.FAMILIES)
def test_damaged_models_never_end_in_an_untyped_error(family):
    made = list(campaign_models.carry_out(family, 40, seed=1))
    assert len(made) == 40 and [found for found in made if found.outcome != "ok"] == []


@pytest.mark.slow
@pytest.mark.parametrize("family", campaign_user.FAMILIES)
def test_odd_files_names_options_and_samples_end_well_or_typed(family):
    made = list(campaign_user.carry_out(family, 20, seed=1))
    assert len(made) == 20 and [found for found in made if found.outcome != "ok"] == []
