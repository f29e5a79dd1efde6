"""What a log decides about a robot's structure: each option with values, unit and criterion.

A further option is declared here, beside its column in `columns`, and compared by `improves`. All
criteria are falls of a loss in logarithmic units: of the errors with which parts of the log are
predicted from the rest, or of the cost of the fit, a log-likelihood. A search over all options of a
robot at once would be one more function over this table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ....core import Array
from .columns import EXTRA, SPEEDS

Adds = Literal["θ", "a constant of θ's columns", "timing", "filter", "targets"]
"""What an option changes: parameters, columns' constants, when and how commands act, the rows'
filter, or the targets that servos follow."""


@dataclass(frozen=True)
class Criterion:
    """How much better a candidate must be than what it replaces; see `improves`."""

    # what is compared: errors of held-out parts, or the cost of the whole fit
    loss: Literal["held-out errors", "cost"]
    # least fall, of the mean logarithm of the errors, or of the cost
    worth: float
    deviations: float = 0.0  # standard errors over the parts that the mean fall must exceed
    # whether the error of every part must fall by so much, not only their mean
    every: bool = False


@dataclass(frozen=True)
class Option:
    """A choice that a log decides."""

    name: str  # name, such as that of a column
    adds: Adds  # what it changes
    unit: str  # unit of its values, or of its parameter where it is a column; "1" for a share
    values: tuple[float, ...]  # first trials; () for a column, which is there or not
    criterion: Criterion  # by which a value is preferred to the one before


def improves(before: Array | float, after: Array | float, by: Criterion) -> bool:
    """Whether a candidate's losses (parts,) are better than those before it, by a criterion.

    A candidate whose losses are not finite never is, and nothing is compared with errors that are
    not.
    """
    old = np.atleast_1d(before)
    new = np.atleast_1d(after)
    errors = by.loss == "held-out errors"
    if not np.isfinite(new).all() or (errors and not np.isfinite(old).all()):
        return False
    change = np.log(new / old) if errors else new - old
    if by.every:
        return bool((change < -by.worth).all())
    error = change.std() / np.sqrt(len(change) - 1) if by.deviations else 0.0
    return bool(change.mean() < -max(by.worth, by.deviations * error))


# -- joints ----------------------------------------------------------------------------------------

REACH = 0.2
"""Delays are searched within ± this [s]."""

JOINT_SPACING = 0.008
SPACING = 0.02
"""Spacing of the first trial delays [s]: of joints, and of a vehicle's actuators."""


def _grid(spacing: float) -> tuple[float, ...]:
    return tuple(np.arange(-REACH, REACH + 1e-9, spacing))


# a column must lower held-out errors by a percent and by their standard error over the folds
COLUMN = Criterion("held-out errors", 0.01, deviations=1.0)
# a column is told for certain only if without it held-out errors are higher by a twentieth
CERTAIN = Criterion("held-out errors", 0.05, deviations=2.0)
# most delays are shared: they are those of clocks and of the network
OWN_DELAY = Criterion("held-out errors", 0.04, deviations=2.0)

SPEED = Option("friction speed", "a constant of θ's columns", "rad/s or m/s", SPEEDS, COLUMN)
CURVES = tuple(
    Option(name, "θ", unit, (), COLUMN)
    for name, unit in (("load", "1"), ("quadratic", "N·m·s²/rad²"), ("cubic", "N·m·s³/rad³"))
)
"""Shapes of friction that are tried in this order, before Stribeck's."""
FALLING = Option("stribeck", "θ", "N·m", SPEEDS, COLUMN)
CONSTANTS = (Option("offset", "θ", "N·m", (), COLUMN), Option("spring", "θ", "N·m/rad", (), COLUMN))
JOINT_DELAY = Option("delay of a joint", "timing", "s", _grid(JOINT_SPACING), OWN_DELAY)

# -- vehicles --------------------------------------------------------------------------------------

# a log-likelihood ratio that justifies one number more, such as a lag
NUMBER = Criterion("cost", 6.0)
# of two numbers, since a further column has one for every velocity
FURTHER = Criterion("cost", 2 * NUMBER.worth)
# a delay within the trials' spacing, such as half a sample's
LITTLE = Criterion("cost", 2.0)

DELAY = Option("delay", "timing", "s", _grid(SPACING), LITTLE)
LAG = Option("lag", "timing", "s", (0.0, 0.01, 0.02, 0.05, 0.1), NUMBER)
MIX = Option("share of the square", "timing", "1", (1.0, 0.0, 0.3, 0.6, 0.8, 0.9), NUMBER)
FURTHER_COLUMNS = tuple(Option(name, "θ", "N or N·m per unit", (), FURTHER) for name in EXTRA)
# the cost of a cut-off is minus the information about θ that its rows hold
INFORMATION = Criterion("cost", 0.0)
# over the cut-off by the motion's bandwidth
CUTOFF = Option("cut-off", "filter", "1", (0.7, 0.5, 0.35, 0.25, 0.17, 0.12), INFORMATION)

# -- servos ----------------------------------------------------------------------------------------

# either half of the logs must be predicted better by a twentieth
EFFECT = Criterion("held-out errors", -np.log(1 - 0.05), every=True)
PROMISING = Criterion("held-out errors", -np.log(0.98), every=True)
PROFILE = Criterion("held-out errors", -np.log(0.9), every=True)

SLIDING = Option("stribeck", "θ", "rad", (1.0,), EFFECT)  # first over the robust residual
LOADED = Option("load", "θ", "1", (0.1,), EFFECT)
TOP_SPEED = Option("speed", "targets", "rad/s or m/s", (), PROFILE)  # first, that of the motion
SMOOTHING = Option("lag", "targets", "s", (0.03, 0.08), PROFILE)

OPTIONS = (
    SPEED,
    *CURVES,
    FALLING,
    *CONSTANTS,
    JOINT_DELAY,
    DELAY,
    LAG,
    MIX,
    *FURTHER_COLUMNS,
    CUTOFF,
    SLIDING,
    LOADED,
    TOP_SPEED,
    SMOOTHING,
)
"""All options."""
