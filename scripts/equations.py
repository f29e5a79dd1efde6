"""The paper's equations and the lines of code that state them, read from the code's own marks.

    python scripts/equations.py     # prints the table of docs/equations.md

A mark is the number of an equation in parentheses in a comment or docstring, such as `# (37)`.
"""

import io
import re
import tokenize
from collections import defaultdict
from html import escape
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "nsaid_mj"
LAST = 96  # the paper's last equation
PLACES = 6  # shown for each equation, at most
ELSEWHERE = {"calibration", "logs", "recording", "pages", "studies", "cli"}
"""Rooms that state no equation; a number in parentheses is the length of an array there."""

TITLES = {
    2: "persistency of excitation",
    3: "kinematics q̇ = J(q) v",
    4: "dynamics M v̇ + C v = F θ",
    5: "forces of an arm",
    6: "forces of a vehicle in water or air",
    7: "forces of a vehicle on the ground",
    8: "M v̇ = W_M θ",
    9: "C v = W_C θ",
    10: "regressor W = W_M + W_C − F",
    13: "W(t, x, v, v̇) θ = 0 along a motion",
    15: "persistent nullspace P(θ)",
    16: "vehicle with one degree of freedom",
    17: "its reduced form",
    20: "acceleration of the system",
    29: "acceleration under an estimate, v̇(t, x, v̂, θ̂)",
    30: "W(t, x, v̂, v̇(…)) θ̂ = 0 at all times",
    31: "regressor W(t, x, v̂, θ̂)",
    32: "subspace P_s(θ) = P(θ) ∪ {0}",
    33: "its orthonormal basis P̄",
    34: "W(t, x, v, θ) P̄ = 0",
    35: "basis P̄_⊥ of its complement",
    36: "Q = [P̄ P̄_⊥]",
    37: "velocity error Δv = v̂ − v",
    40: "coordinates θ̄_P⊥ and θ̄_P",
    42: "goal: θ̂ converges to P(θ)",
    43: "the same as a distance",
    44: "law for v̂",
    45: "law for θ̂",
    46: "assumption that keeps M̂ positive definite",
    54: "error dynamics of Δv",
    64: "error dynamics in θ̄_P⊥",
    66: "Lyapunov function V",
    69: "V̇ = −Δvᵀ M K Δv",
    70: "Δv → 0",
    74: "W(t, x, v, θ) P̄_⊥ θ̄_P⊥ → 0",
    75: "excitation orthogonal to P(θ)",
}

_LISTED = r"; |, (?!and|with|but|which)[\w·]| \["  # what follows a size in a list of arrays
_MARK = re.compile(rf"(?:^|(?<=[\s,;:=]))\((\d{{1,2}}(?:(?:, |–)\d{{1,2}})*)\)(?!{_LISTED})")


class Place(NamedTuple):
    """A line that is marked with an equation."""

    file: Path
    line: int
    text: str


def numbers_of(mark: str) -> list[int]:
    """The equations of a mark: `44, 45`, or `4–6`; empty for a shape such as (6, 6) or (3)."""
    parts = [int(part) for part in re.split(r", |–", mark)]
    if parts != sorted(set(parts)) or not 2 <= parts[0] <= parts[-1] <= LAST:
        return []
    if not set(parts) & set(TITLES):
        return []
    if "–" in mark:
        return list(range(parts[0], parts[-1] + 1))
    return parts if len(parts) == 1 or parts[-1] >= 13 else []  # shapes are small


def marks(package: Path = PACKAGE) -> dict[int, list[Place]]:
    """Every marked line of a package by equation, marks beside code before those in docstrings."""
    found: dict[int, list[tuple[bool, Place]]] = defaultdict(list)
    for file in sorted(package.rglob("*.py")):
        if file.relative_to(package).parts[0] in ELSEWHERE:
            continue
        text = file.read_text(encoding="utf-8")
        lines = text.splitlines()
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            docstring = token.type == tokenize.STRING and token.string.endswith('"""')
            if token.type != tokenize.COMMENT and not docstring:
                continue
            for offset, part in enumerate(token.string.splitlines()):
                number = token.start[0] + offset
                for mark in _MARK.findall(part.lstrip("#")):
                    for equation in numbers_of(mark):
                        place = Place(file, number, lines[number - 1].strip())
                        found[equation].append((docstring, place))
    return {
        equation: list(dict.fromkeys(place for _, place in sorted(found[equation])))
        for equation in sorted(found)
    }


def marked_files() -> list[Path]:
    """The files that state an equation."""
    return sorted({place.file for places in marks().values() for place in places})


def table() -> str:
    """A Markdown table: equation, what it is, and the lines that state it, with links."""
    rows = ["| equation | what | code |", "|---|---|---|"]
    for equation, places in marks().items():
        cells = []
        for place in places[:PLACES]:
            name = place.file.relative_to(PACKAGE)
            link = f"code/{name.with_suffix('.html')}#__codelineno-0-{place.line}"
            shown = escape(place.text.strip("\"' ")).replace("|", "&#124;").replace("`", "")
            cells.append(
                f'<a href="{link}">{name}:{place.line}</a><br><code>{shown}</code>'
            )  # HTML, as mkdocs knows no anchors of lines
        if len(places) > PLACES:
            cells.append(f"and {len(places) - PLACES} more")
        rows.append(f"| ({equation}) | {TITLES.get(equation, '')} | {'<br>'.join(cells)} |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    print(table())
