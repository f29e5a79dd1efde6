"""Identifiability of every parameter in words: status, interval, combination, suggestion; scale.

With all masses, frictions and gains doubled, the motion is the same. A known number, such as a
motor's gain, fixes this common scale if the log couples it to all other parameters; so do commands
stated in N·m or N. Otherwise the scale comes from the model file's masses.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...base import Finding, InvalidInput, UnknownName
from ...core import Array, ParameterSpace, number
from ...lab import INTERVAL
from ...report import Parameter, Status
from .choose.columns import COLUMNS, HELD
from .fit import Combinations, Fit, Precision, combinations
from .problem import FitProblem, Mask
from .result import Combination

_EXCITED = 0.5  # expected gain of information, in prior variances, that counts as excitation
_NARROWED = 0.6  # deviation of a relative gain over the prior's, below which it is identified
_SHARP = 0.05  # relative deviations below and above which the prior does not matter
_BLUNT = 0.1
_ABSOLUTE = 0.5  # relative half-width beyond which a gain's own value is not identified
NOTHING = float(np.log(1000.0))
"""Half an interval of ln θ beyond which it says nothing."""
_TERMS = 6  # terms of a combination that are written out
_TRADED = " over its gain"  # of a gain that its joint's friction may stand for


def parameters_in_words(
    problem: FitProblem, fit: Fit, exact: Precision, gain_spread: Array, common: Array
) -> tuple[Parameter, ...]:
    """All parameters with interval and status.

    gain_spread (k,) are the prior standard deviations of log k, common (p, p) are the derivatives
    of the logarithms of all parameters' scales where nothing fixes them, else 0.
    """
    space = problem.space
    combined = combinations(problem)
    deviation = exact.deviation
    gains = _relative_gains(problem, fit, exact, gain_spread)
    kinds = [block.name for block in space.blocks for _ in block.names]
    rows = zip(space.names, space.labels, kinds, space.units, strict=True)
    signed = ~_positive(space)
    found = []
    for index, (name, label, block, unit) in enumerate(rows):
        value = float(fit.theta[index])
        sd = float(deviation[index])
        low, high = interval(value, sd, value > 0 and not signed[index], space.scale[index])
        if block == COLUMNS["load"].block:
            high = max(min(high, HELD), value)
        relative = None
        others = "gains"
        if index in gains:
            status, words, relative = gains[index]
            others = "other gains" if len(gains) > 1 else "links"
        else:
            apart = exact.of(np.eye(len(common))[index] - value * common[index])
            status, words = _status(problem, exact, combined, index, value, apart)
        if status == "identified" and common.any():
            status = "only in combination"
            words = f"{label} over the {others}"
        prior = float(problem.prior[index])
        if problem.steady is not None and problem.steady[index]:
            # the fitted value holds any other constant force too, so the sheet's remains possible
            factor = float(np.exp(INTERVAL * problem.spread[index]))
            low = min(low, prior / factor)
            high = max(high, prior * factor)
        found.append(
            Parameter(name, label, block, unit, value, low, high, prior, status, words, relative)
        )
    return tuple(found)


def _positive(space: ParameterSpace) -> Mask:
    """(p,) whether a parameter cannot be negative.

    Beside those that are positive alone: a link's mass, and what lies on the diagonal of a mass
    matrix. An entry off it has either sign, also where its unit is kg.
    """
    found = space.geometries == "positive"
    for block, rows in space:
        if block.geometry == "pseudo_inertia":
            found[rows.start] = True
        elif block.geometry == "tied":
            found[[rows.start + at for i, j, at, _ in block.entries if i == j]] = True
        elif block.geometry == "spd":
            order = round((2 * len(block)) ** 0.5)
            i, j = np.triu_indices(order)
            found[rows] = i == j
    return np.asarray(found)


def interval(value: float, sd: float, positive: bool, usual: float) -> tuple[float, float]:
    """The 95 % interval; of a `positive` value a factor, from 0 to infinity if it says nothing.

    One of either sign says nothing if it is as much wider than both the value and its `usual` size.
    """
    half = INTERVAL * sd
    if not positive:
        if half > np.exp(NOTHING) * max(abs(value), abs(usual)):
            return -np.inf, np.inf
        return value - half, value + half
    if half > NOTHING * value:
        return 0.0, np.inf
    factor = float(np.exp(half / value))
    return value / factor, value * factor


def _status(
    problem: FitProblem,
    exact: Precision,
    combined: Combinations,
    index: int,
    value: float,
    sd: float,
) -> tuple[Status, str]:
    """Status of a parameter other than a gain, and its combination in words."""
    if problem.known[index]:
        return "known", ""
    gained = exact.data[index, index] * exact.prior[index] ** 2
    members = combined.members(index)
    if gained < _EXCITED or not members:
        return "not excited", ""
    if len(members) != 1 or len(combined.expression(members[0])) > 1:
        return "only in combination", in_words(combined.expression(members[0]), problem.space)
    if abs(value) < INTERVAL * sd:
        return "below the noise", ""
    return "identified", ""


def _relative_gains(
    problem: FitProblem, fit: Fit, exact: Precision, spread: Array
) -> dict[int, tuple[Status, str, float | None]]:
    """Status, combination and relative half-width of every gain.

    A gain is identified if the log narrows its ratio to the best known gains (their mean, weighted
    by the inverse variances of their logarithms), and its own interval is no wider than ±50 %. For
    a single gain, only its own interval counts.
    """
    at = problem.space.actuators
    found = {}
    deviation = np.array([exact.of(e) for e in np.eye(len(problem.space))[at]]) / fit.theta[at]
    weight = 1 / np.maximum(deviation, 1e-6) ** 2
    for place, index in enumerate(at.tolist()):
        joint = problem.space.labels[index].partition(" of ")[2]
        if problem.known[index]:
            found[index] = ("known", "", None)
            continue
        if problem.steady is not None and problem.steady[index]:
            acts = bool(problem.Y[:, :, index].any())
            label = f"constant force of {joint} + any other constant force"
            status: Status = "only in combination" if acts else "not excited"
            found[index] = (status, label if acts else "", None)
            continue
        others = np.where(np.arange(len(at)) == place, 0.0, weight)
        weights = np.zeros(len(problem.space))
        if others.any():
            weights[at] = -others / others.sum() / fit.theta[at]
        weights[index] = 1 / fit.theta[index]
        apart = exact.of(weights)
        relative = INTERVAL * apart if others.any() else None
        if others.any() and apart < np.clip(_NARROWED * spread[place], _SHARP, _BLUNT):
            firm = INTERVAL * deviation[place] < _ABSOLUTE  # else only its ratio to other gains
            words = "" if firm else f"{problem.space.labels[index]} over the other gains"
            found[index] = ("identified" if firm else "only in combination", words, relative)
        elif not others.any() and INTERVAL * deviation[place] < _ABSOLUTE:
            found[index] = ("identified", "", relative)
        else:
            words = f"friction and rotor inertia of {joint}{_TRADED}"
            found[index] = ("only in combination", words, relative)
    return found


def in_words(expression: dict[int, float], space: ParameterSpace) -> str:
    """A combination such as "Izz of link_1 + rotor inertia of joint_1 − 0.05 · mass of link_3"."""
    # rounded, so that terms of one size keep their order whatever the last bits are
    size = {index: float(f"{abs(w) * space.scale[index]:.9g}") for index, w in expression.items()}
    terms = sorted(expression.items(), key=lambda item: -size[item[0]])
    words = ""
    for place, (index, weight) in enumerate(terms[:_TERMS]):
        sign = "−" if weight < 0 else "+"
        factor = "" if abs(abs(weight) - 1) < 5e-4 else f"{abs(weight):.3g} · "
        lead = ("−" if weight < 0 else "") if not place else f" {sign} "
        words += f"{lead}{factor}{space.labels[index]}"
    rest = len(terms) - _TERMS
    return words + (f" + {rest} more" if rest > 0 else "")


def combinations_in_words(
    problem: FitProblem, fit: Fit, exact: Precision
) -> tuple[Combination, ...]:
    """The base parameters of the log with intervals, gains given."""
    combined = combinations(problem)
    found = []
    for index, weights in zip(combined.independent, combined.weights, strict=True):
        if np.count_nonzero(weights) < 2:
            continue
        value = float(weights @ fit.theta)
        sd = exact.of(weights)
        words = in_words(combined.expression(index), problem.space)
        unit = problem.space.units[index]
        found.append(Combination(words, unit, value, value - INTERVAL * sd, value + INTERVAL * sd))
    return tuple(found)


def suggest(problem: FitProblem, exact: Precision, parameters: tuple[Parameter, ...]) -> str:
    """The one number that, if known, would narrow the intervals of the gains most."""
    at = problem.space.actuators
    free = at[~problem.known[at]]
    if not len(free):
        return ""
    value = np.array([p.value for p in parameters])

    def halves(precision: Precision, known: int) -> Array:
        """Relative half-widths of the intervals of all gains but a known one, as printed."""
        others = free[free != known]
        return np.array([INTERVAL * precision.of(np.eye(len(value))[k]) for k in others]) / np.abs(
            value[others]
        )

    best = None
    gained = 0.0
    ends = 0.0, 0.0  # median half-widths before and after
    masses = []
    for i, p in enumerate(parameters):
        if p.unit == "kg" and p.block != "rotor inertia" and p.status != "not excited":
            masses.append(i)
    for i in [*free.tolist(), *masses]:
        if not exact.covariance[i, i] > 0 or not (free != i).any():
            continue
        before, after = (float(np.median(halves(each, i))) for each in (exact, exact.knowing(i)))
        if 1 - after / before > gained:
            best = i
            gained = 1 - after / before
            ends = before, after
    weak = [p.label for p in parameters if p.block == "motor gain" and _TRADED in p.combination]
    words = ""
    if best is not None and gained > _WORTH:
        words = (
            f"One known number would help most: {parameters[best].label} "
            f"(`--known {parameters[best].name}=…`) narrows the other gains from about "
            f"±{number(100 * ends[0], significant=2)} % to "
            f"±{number(100 * ends[1], significant=2)} %."
        )
    if weak:
        words += (
            f" This motion does not separate {', '.join(weak)} from friction. Move these joints "
            "faster, or repeat the motion with a known payload."
        )
    return words.strip()


_WORTH = 0.1  # share of the median half-width that a suggestion must save
_SURE = 0.15  # standard deviation of the scale's logarithm, that of commands in N·m, below which a
# known value fixes it
_REMEDY = "Give one motor's gain{}, or weigh a load that one of two logs carries: --load."
_FURTHER = (
    "The known value is not enough: give {} too, or weigh a load that one of two logs carries: "
    "--load."
)


class Scale(NamedTuple):
    """Source and uncertainty of the common scale."""

    weights: Array  # (p, p) c: c δ is the relative change of the scale of every limb under δ of θ̂
    deviation: float  # standard deviation of its logarithm, the largest of all limbs
    fixed: bool  # whether commands or a known number fix it
    words: str  # its source, in words
    limbs: int  # number of limbs that only the base connects
    remedy: str  # what would fix it

    @property
    def factor(self) -> float:
        """Half the 95 % interval of the scale, as a factor."""
        return float(np.exp(INTERVAL * self.deviation))

    @property
    def bounds(self) -> str:
        """How well absolute values hold."""
        if INTERVAL * self.deviation > NOTHING:
            return "absolute values are not determined"
        return f"absolute values only to a factor of {self.factor:.2g}"


def common_scale(
    problem: FitProblem,
    exact: Precision,
    theta: Array,
    stated: bool,
    weightless: bool,
    known: Mapping[str, float],
) -> Scale:
    """The common scale of the estimate θ̂ (p,) of a problem.

    `stated` is whether commands are in N·m or N, `weightless` whether the model file has no masses,
    `known` the user's parameters.
    """
    at = problem.space.actuators
    slopes = problem.size.slopes(theta)
    gains = exact.deviation[at] / np.abs(theta[at])
    # the file's gains may contradict its masses: then no gain is known as well as the size is
    deviation = max(*map(exact.of, slopes), min(gains, default=0.0))
    fixed = stated or (bool(known) and deviation < _SURE)
    given = "the known " + ", ".join(f"{name} = {value:g}" for name, value in known.items())
    masses = "" if weightless else " and the masses of the model file"
    if stated and not (known and deviation < _SURE / 3):
        words = f"commands stated in N·m or N (±15 %){masses}"
    elif fixed:
        words = given
    elif weightless:
        words = "guesses, as the model file has no masses: only ratios of parameters hold"
    else:
        words = "the masses of the model file: a calibrated gain or a weighed payload would fix it"
    remedy = _REMEDY.format(" of each limb" if len(slopes) > 1 else "")
    best = _telling(problem, exact, slopes, theta)
    if known and best is not None:
        remedy = _FURTHER.format(f"the {problem.space.labels[best]}")
    return Scale(slopes[problem.size.limb], deviation, fixed, words, len(slopes), remedy)


def _telling(problem: FitProblem, exact: Precision, slopes: Array, theta: Array) -> int | None:
    """The gain, not known, that goes most with the least certain size; None if there is none."""
    free = [i for i in problem.space.actuators.tolist() if not problem.known[i]]
    size = max(slopes, key=exact.of)
    C = exact.covariance
    told = {i: float((C[i] @ size) ** 2 / max(C[i, i], 1e-300 * theta[i] ** 2)) for i in free}
    return max(told, key=lambda i: told[i]) if told else None


def with_known(problem: FitProblem, known: Mapping[str, float]) -> FitProblem:
    """The problem with parameters held at known values.

    The prior shape of a link of known mass is the file's, and it contributes to the size.

    Raises:
        UnknownName: there is no such parameter.
        InvalidInput: a value is not finite, or not positive where it must be.
    """
    prior = problem.prior.copy()
    fixed = problem.known.copy()
    space = problem.space
    for name, value in known.items():
        index = index_of(problem, name)
        place = next(p for _, p in space if p.start <= index < p.stop)
        mass = space.geometries[index] == "pseudo_inertia" and index == place.start
        positive = mass or space.geometries[index] == "positive"
        if not np.isfinite(value) or (positive and not value > 0):
            expected = "a number > 0" if positive else "a finite number"
            raise InvalidInput(name, expected, value, f"Its unit is {space.units[index]}.")
        if mass:
            prior[place] *= value / prior[index]  # scale the whole link, which stays physical
        at, gains = problem.size.by_gain()
        prior[at[gains == index]] *= value / prior[index]
        prior[index] = value
        fixed[index] = True
    return replace(problem, prior=prior, known=fixed)


def _share(problem: FitProblem, index: int) -> float:
    """Share of the bodies' size due to the body whose mass a parameter is; 0 for others."""
    own = next(p for _, p in problem.space if p.start <= index < p.stop)
    if problem.space.units[index] != "kg" or index != own.start:
        return 0.0
    parts = problem.size.weights[problem.size.limb[index]] * problem.prior
    return float(np.clip(parts[own].sum() / parts.sum(), 0.0, 1.0))


def index_of(problem: FitProblem, name: str) -> int:
    """The index of a parameter by name or label; raises `UnknownName` if there is none."""
    space = problem.space
    names = space.names if name in space.names else space.labels
    if name not in names:
        raise UnknownName("parameter", name, [*space.names, *space.labels])
    return list(names).index(name)


def informed(problem: FitProblem, known: Mapping[str, float], weightless: bool) -> FitProblem:
    """The problem with known values, of a model file with or without masses; see `with_known`."""
    return with_known(rescaled(problem, known) if weightless else problem, known)


def rescaled(problem: FitProblem, known: Mapping[str, float]) -> FitProblem:
    """The problem of a model without masses, with its arbitrary scale moved to known values."""
    given = with_known(problem, known).prior
    at = np.flatnonzero((given != problem.prior) & (given > 0) & (problem.prior > 0))
    if not len(at):
        return problem
    factor = float(np.exp(np.mean(np.log(given[at] / problem.prior[at]))))
    free = problem.space.geometries == "free"
    spread = np.where(free, factor * problem.spread, problem.spread)
    return replace(problem, prior=factor * problem.prior, spread=spread)


def idle_values(problem: FitProblem, scale: Scale, known: Mapping[str, float]) -> list[Finding]:
    """Reports known values that do not fix the scale: their effect, and the reason."""
    if scale.fixed:
        return []
    combined = combinations(problem)
    found = []
    for name, value in known.items():
        index = index_of(problem, name)
        why = "it has no effect in the log"
        share = _share(problem, index)
        members = combined.members(index)
        if index in problem.space.actuators:
            why = "in this log the other parameters hardly depend on it"
            why += ", and those of other limbs not at all" if scale.limbs > 1 else ""
        elif members:
            seen = in_words(combined.expression(members[0]), problem.space)
            why = f"the log shows it only in combination ({seen})"
        effect = "it changes no other parameter"
        if share > 0.005:
            effect = (
                f"it determines {100 * share:.0f} % of the weight on which the overall scale rests"
            )
        label = problem.space.labels[index]
        text = (
            f"the known value {value:g} does not fix the overall scale: {why}; {effect}, and "
            f"{scale.bounds}"
        )
        data = {"share": share}
        found.append(Finding("warning", "known_in_combination", label, text, scale.remedy, data))
    return found
