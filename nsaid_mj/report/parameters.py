"""Tables of the parameters of any result, for page and terminal."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..core import ABSENT, number
from .page import Cell, Fold, Link, Table
from .result import Mark, Parameter, Result
from .wording import estimate

_OPEN = 12  # parameters in total, up to which no table is collapsed
_LINES = 16  # of a table on the terminal, at most


def relative(parameter: Parameter) -> str:
    """The half-width of a gain's interval relative to the other gains, such as "±1.2 %"."""
    if parameter.relative is None:
        return ABSENT
    return f"±{number(float(f'{100 * parameter.relative:.2g}'))} %"


class ParameterTables:
    """The parameters of a result as tables of a page.

    Args:
        result: has the parameters.
        numbers: of the combinations that the page lists, which stand beside their parameters.
    """

    def __init__(self, result: Result, numbers: Mapping[str, int] | None = None) -> None:
        self._result = result
        self._numbers = numbers or {}

    def of(self, parameters: Sequence[Parameter]) -> Table:
        """Parameters, at least one, with intervals, prior and true values where known.

        A narrow terminal folds the prior first, then what the other columns tell, too.
        """
        judged = any(p.status for p in parameters)
        known = any(p.true is not None for p in parameters)
        related = any(p.relative is not None for p in parameters)
        heads = ["parameter", "estimate", *["95 % interval"] * judged, *["relative"] * related]
        heads += ["prior"] * any(math.isfinite(p.prior) for p in parameters) + ["true"] * known
        heads += ["unit", *["status"] * judged]
        cells = [_cells(p, self._numbers.get(p.combination, 0)) for p in parameters]
        words = [k for k, head in enumerate(heads) if head in {"parameter", "unit", "status"}]
        spare = ["prior", "95 % interval" if known and related else "relative"]
        return Table(
            heads,
            [[line[head] for head in heads] for line in cells],
            words,
            spare=[heads.index(head) for head in spare if head in heads],
        )

    def folds(self, gains: bool = True) -> list[Fold]:
        """A table for each block of θ, with the number of parameters of each status."""
        few = len(self._result.parameters) <= _OPEN
        return [
            Fold(
                members[0].part if name in self._result.bodies else _kind(name, members),
                [self.of(members)],
                Parameter.counted(members),
                str(len(members)),
                few or members[0].is_gain,
            )
            for name, members in self._result.blocks.items()
            if gains or not members[0].is_gain
        ]

    def gains(self) -> list[Table]:
        """The table of the gains; none without gains."""
        gains = self._result.gains
        if not gains:
            return []
        parts = [p.part for p in gains]
        whole = self.of(gains)
        lines = [
            [(Link(p.label.removesuffix(p.part).strip()), p.part), *line[1:]]
            if parts.count(p.part) == 1 and p.part != p.label
            else line
            for p, line in zip(gains, whole.lines, strict=True)
        ]
        return [replace(whole, heads=["gains", *whole.heads[1:]], lines=lines, most=_LINES)]


def _cells(p: Parameter, combination: int) -> dict[str, Cell]:
    """The cells of a parameter's line, by column; `combination` is its number, 0 for none."""
    value, interval = estimate(p.value, p.low, p.high)
    half = (p.high - p.low) / 2
    status = Mark.of(p.status)
    numbered = Link(f"C{combination}", f"combination-{combination}")
    link = numbered if combination else Link(p.combination)
    return {
        "parameter": p.label,
        "estimate": value,
        "95 % interval": ABSENT if p.status == "known" else interval,
        "relative": relative(p),
        "prior": number(p.prior),
        # with as many digits as the estimate
        "true": ABSENT if p.true is None else estimate(p.true, p.true - half, p.true + half)[0],
        "unit": p.unit,
        "status": (status, link) if p.combination else status,
    }


def _kind(block: str, members: Sequence[Parameter]) -> str:
    """The kind of a block's parameters in words: the block's name where they differ by it."""
    kinds = {member.kind for member in members}
    return kinds.pop() if len(kinds) == 1 else block
