"""How numbers and statistics are phrased, on the terminal, on pages and in recordings."""

import math

from ..core import ABSENT, number, rounded


def estimate(value: float, low: float, high: float) -> tuple[str, str]:
    """An estimate and its 95 % interval, rounded to two digits of the interval's half-width."""
    half = (high - low) / 2
    if low <= 0 and math.isinf(high):
        return number(value), "not determined"
    if not math.isfinite(half) or half <= 0:
        return number(value), ABSENT if half == 0 else f"{number(low)} … {number(high)}"
    quantum = 10.0 ** (math.floor(math.log10(half)) - 1)
    least = 10.0 ** (math.floor(math.log10(abs(value))) - 1) if value else quantum
    if low > 0:  # an interval of a factor: two digits of the estimate too
        quantum = min(quantum, least)
    return number(value, quantum), f"{number(low, quantum)} … {number(high, quantum)}"


def percent(value: float | None, digits: int = 3) -> str:
    """A share as a percentage; – for None."""
    return ABSENT if value is None else f"{rounded(100 * value, digits)} %"
