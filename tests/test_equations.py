"""The table of equations is read from marks, and does not take lengths of arrays for them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.support.faulty import CHECKOUT

sys.path.insert(0, str(CHECKOUT / "scripts"))
import equations  # a script, not part of the package


@pytest.mark.parametrize(
    "mark, wanted",
    [
        ("44", [44]),
        ("44, 45", [44, 45]),
        ("32–36", [32, 33, 34, 35, 36]),
        ("10, 31", [10, 31]),
        ("6, 6", []),
        ("3, 8", []),
        ("0", []),
        ("99", []),
    ],
)
def test_a_mark_names_equations(mark: str, wanted: list[int]) -> None:
    assert equations.numbers_of(mark) == wanted


def test_marks_are_found_beside_code_and_in_docstrings_but_not_in_lists_of_sizes(
    tmp_path: Path,
) -> None:
    (tmp_path / "law.py").write_text(
        '"""The law of (44, 45), with (10) for W.\n\nm, m·c (3), I (6); mass (10) [kg]."""\n'
        'dv = v_hat - v  # (37)\nwords = "see (46)"\n'
    )
    found = equations.marks(tmp_path)
    assert {number: [place.line for place in places] for number, places in found.items()} == {
        10: [1],
        37: [4],
        44: [1],
        45: [1],
    }


def test_the_law_itself_is_in_the_table() -> None:
    table = equations.table()
    assert "core/laws/rk4.py" in table
    assert {37, 44, 45, 66, 69, 75} <= set(equations.marks())
