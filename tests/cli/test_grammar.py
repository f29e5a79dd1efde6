"""The command lines of `nsaid`: one grammar, and a help that can be read."""

from __future__ import annotations

from pathlib import Path

import pytest

from nsaid_mj.cli import grammar
from nsaid_mj.cli.commands import command
from tests.support.faulty import shell


@pytest.mark.parametrize("word", ["identify", "inspect"])
@pytest.mark.parametrize(
    "line",
    [
        "a.csv b.csv --model arm.urdf",
        "--model arm.urdf a.csv b.csv",
        "--log a.csv b.csv --model arm.urdf",
        "--model arm.urdf --log a.csv b.csv",
        "arm.urdf a.csv b.csv",
        "a.csv b.csv arm.urdf",
        "a.csv --log b.csv --model arm.urdf",
    ],
)
def test_logs_and_model_stand_in_any_order_with_or_without_flags(word: str, line: str) -> None:
    chosen = grammar.parse([word, *line.split()])
    assert chosen.model == "arm.urdf"
    assert {*chosen.logs, *chosen.log} == {Path("a.csv"), Path("b.csv")}


def test_a_word_alone_is_a_packed_robot_unless_it_is_a_file(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert grammar.parse(["identify", "tx40"]).model == "tx40"
    Path("tx40").mkdir()
    assert grammar.parse(["identify", "tx40"]).model is None


@pytest.mark.parametrize("line", [*grammar.COMMANDS, "run ur5", "run bluerov2", "sweep ur5"])
def test_help_shows_no_none_and_no_empty_default(line: str, capsys) -> None:
    words = line.split()
    run = command if len(words) > 1 else grammar.parse
    with pytest.raises(SystemExit):
        run([*words, "--help"])
    said = capsys.readouterr().out
    assert "{None}|" not in said.replace("{None}|{[INT", "")
    for nothing in ("(default: )", "(default: None)", "(default: '')"):
        assert nothing not in " ".join(said.split())


def test_a_missing_log_is_no_robot_of_that_name(tmp_path: Path) -> None:
    code, said = shell("identify", tmp_path / "log.csv")
    assert code == 2 and "log.csv: there is no such file" in said.err
