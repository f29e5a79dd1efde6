"""Units of log channels and their factors to SI."""

import re
from collections.abc import Mapping
from math import pi
from typing import Literal

Quantity = Literal["position", "velocity", "command"]

TURN = 2 * pi

FACTORS: Mapping[Quantity, Mapping[str, float]] = {
    "position": {  # ticks: over the counts per turn
        "rad": 1.0, "deg": pi / 180, "turns": TURN, "ticks": TURN, "m": 1.0, "mm": 1e-3,
    },
    "velocity": {
        "rad/s": 1.0, "deg/s": pi / 180, "turns/s": TURN, "rpm": TURN / 60, "ticks/s": TURN,
        "m/s": 1.0, "mm/s": 1e-3,
    },
    "command": {
        "N·m": 1.0, "mN·m": 1e-3, "N": 1.0, "A": 1.0, "mA": 1e-3, "V": 1.0, "%": 1.0, "raw": 1.0,
        "rpm": TURN / 60,
    },
}  # fmt: skip
"""Factor from each unit to the unit of `Log`: rad or m, rad/s or m/s, and `si` of a command."""

TIME = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
"""Nanoseconds in each unit of time."""

_ALIASES = {
    alias: unit
    for unit, aliases in {
        "rad": "radian radians",
        "deg": "degree degrees °",
        "turns": "rev revs turn",
        "ticks": "counts",
        "rad/s": "rads radps rad_s",
        "deg/s": "degps deg_s dps °/s",
        "m/s": "mps m_s",
        "N·m": "nm n·m n.m n*m",
        "mN·m": "mnm",
        "A": "amp amps ampere",
        "mA": "milliamps",
        "V": "volt volts",
        "%": "percent",
        "us": "µs μs usec",
        "ms": "msec",
        "ns": "nsec",
        "s": "sec secs seconds",
    }.items()
    for alias in aliases.split()
}
_KNOWN = {name.lower(): name for names in (*FACTORS.values(), TIME) for name in names}


def canonical(text: str) -> str:
    """The unit's canonical spelling: `Nm` and `n*m` are `N·m`; unknown texts are returned as is."""
    plain = text.strip()
    lower = plain.lower()
    if lower in ("ma", "a", "n", "v", "m"):
        return _KNOWN[lower]
    return _ALIASES.get(lower) or _KNOWN.get(lower) or plain


def si(unit: str) -> str:
    """The unit of a command after its conversion; "" for raw numbers."""
    return {"mN·m": "N·m", "mA": "A", "raw": "", "rpm": "rad/s"}.get(unit, unit)


def of_name(name: str, allowed: Mapping[str, float]) -> tuple[str, str]:
    """A column's name without a unit at its end, and that unit if it is in `allowed`, else "".

    `q1_deg`, `q1 [deg]`, `q1 (deg)` and `q1/deg` all state a unit.
    """
    if found := re.fullmatch(r"(.*?)[ _/.]*[\[(]([^\])]+)[\])]", name.strip()):
        unit = canonical(found[2])
        return (found[1], unit) if unit in allowed else (name, "")
    parts = re.split(r"[_ /.]+", name.strip())
    for count in (2, 1):
        if len(parts) > count:
            unit = canonical("_".join(parts[-count:]))
            joined = canonical("/".join(parts[-count:]))
            for one in (unit, joined):
                if one in allowed:
                    return "_".join(parts[:-count]), one
    return name, ""
