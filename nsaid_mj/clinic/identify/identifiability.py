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
from ...core import Array, ParameterSpace
from ...lab import INTERVAL
from ...report import Explains, Parameter, Status
from .fit import Combinations, Fit, Precision, combinations
from .problem import FitProblem
from .result import Combination, JointStructure

_EXCITED = 0.5  # expected gain of information, in prior variances, that counts as excitation
_NARROWED = 0.6  # deviation of a relative gain over the prior's, below which it is identified
_SHARP = 0.05  # relative deviations below and above which the prior does not matter
_BLUNT = 0.1
_ABSOLUTE = 0.5  # relative half-width beyond which a gain's own value is not identified
_TERMS = 6  # terms of a combination that are written out
_TRADED = " over its gain"  # of a gain that its joint's friction may stand for
_GOOD = 0.2  # held-out NRMSE
_FAIR = 0.5


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
    found = []
    for index, (name, label, block, unit) in enumerate(rows):
        value = float(fit.theta[index])
        sd = float(deviation[index])
        low = value - INTERVAL * sd
        high = value + INTERVAL * sd
        if value > 0 and (space.geometries[index] == "positive" or unit == "kg"):
            factor = float(np.exp(min(INTERVAL * sd / value, 50.0)))
            low = value / factor
            high = value * factor
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
    for number, index in enumerate(at.tolist()):
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
        others = np.where(np.arange(len(at)) == number, 0.0, weight)
        weights = np.zeros(len(problem.space))
        if others.any():
            weights[at] = -others / others.sum() / fit.theta[at]
        weights[index] = 1 / fit.theta[index]
        apart = exact.of(weights)
        relative = INTERVAL * apart if others.any() else None
        if others.any() and apart < np.clip(_NARROWED * spread[number], _SHARP, _BLUNT):
            firm = INTERVAL * deviation[number] < _ABSOLUTE  # else only its ratio to other gains
            words = "" if firm else f"{problem.space.labels[index]} over the other gains"
            found[index] = ("identified" if firm else "only in combination", words, relative)
        elif not others.any() and INTERVAL * deviation[number] < _ABSOLUTE:
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
    for number, (index, weight) in enumerate(terms[:_TERMS]):
        sign = "−" if weight < 0 else "+"
        factor = "" if abs(abs(weight) - 1) < 5e-4 else f"{abs(weight):.3g} · "
        lead = ("−" if weight < 0 else "") if not number else f" {sign} "
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


def verdict(joints: tuple[JointStructure, ...], arm: bool = True) -> tuple[Explains, str]:
    """Whether the structure explains the log, and the verdict in a sentence.

    With `arm` the parts are joints; a vehicle has velocities.
    """
    of = "joints" if arm else "velocities"
    joints = tuple(j for j in joints if np.isfinite(j.held_out))
    if not joints:
        return "no", "No part of the log could be predicted from the others: it is too short."
    held_out = np.array([j.held_out for j in joints])
    figures = (
        f"on held-out data it misses {_range(held_out)} of the commands' variation "
        "(100 %: no better than the mean)"
    )
    values = np.fmax(held_out, [np.nan if j.validation is None else j.validation for j in joints])
    good = int(np.sum(values < _GOOD))
    worst = joints[int(np.argmax(values))]
    checked = [j.validation for j in joints if j.validation is not None]
    if np.isfinite(checked).any():
        figures += f"; on the validation log {_range(np.array(checked))}"
    n = len(joints)
    if not (values < _FAIR).all():
        poor = [j.name for j, value in zip(joints, values, strict=True) if not value < _FAIR]
        explains: Explains = "no" if len(poor) > n / 2 else "partly"
        return explains, (
            f"The structure does not explain the motion of {', '.join(poor)}: {figures}. "
            f"Do not trust parameters of these {of}."
        )
    if good == n:
        return "yes", f"The structure explains the log: {figures}."
    return "partly", (
        f"The structure explains {good} of {n} {of} well and the others roughly, "
        f"worst {worst.name}: {figures}."
    )


def _range(nrmse: Array) -> str:
    """The least and the largest error, in percent."""
    ends = dict.fromkeys(f"{100 * end:.2g}" for end in (np.nanmin(nrmse), np.nanmax(nrmse)))
    return f"{' to '.join(ends)} %"


def suggest(problem: FitProblem, exact: Precision, parameters: tuple[Parameter, ...]) -> str:
    """The one number that, if known, would narrow the intervals of the gains most."""
    at = problem.space.actuators
    free = at[~problem.known[at]]
    if not len(free):
        return ""
    C = exact.covariance
    value = np.array([p.value for p in parameters])
    variance = np.diag(C)[free] / value[free] ** 2
    best = None
    gained = 0.0
    masses = []
    for i, p in enumerate(parameters):
        if p.unit == "kg" and p.block != "rotor inertia" and p.status != "not excited":
            masses.append(i)
    for i in [*free.tolist(), *masses]:
        if not C[i, i] > 0:
            continue
        others = free != i
        left = variance - C[free, i] ** 2 / (C[i, i] * value[free] ** 2)
        shares = 1 - left[others] / np.maximum(variance[others], 1e-300)
        if others.any() and shares.mean() > gained:
            best = i
            gained = float(shares.mean())
    weak = [p.label for p in parameters if p.block == "motor gain" and _TRADED in p.combination]
    words = ""
    if best is not None and gained > 0.1:
        before = INTERVAL * float(np.sqrt(np.mean(variance)))
        after = before * float(np.sqrt(1 - gained))
        words = (
            f"One known number would help most: {parameters[best].label} "
            f"(`--known {parameters[best].name}=…`) narrows the other gains from about "
            f"±{100 * before:.2g} % to ±{100 * after:.2g} %."
        )
    if weak:
        words += (
            f" {', '.join(weak)}: this motion does not separate them from friction; a payload of "
            "known mass, or faster motion of these joints, would."
        )
    return words.strip()


_SURE = 0.15  # standard deviation of the scale's logarithm, that of commands in N·m, below which a
# known value fixes it
_REMEDY = "Give one motor's gain{}, or weigh a load that one of two logs carries: --load."


class Scale(NamedTuple):
    """Source and uncertainty of the common scale."""

    weights: Array  # (p, p) c: c δ is the relative change of the scale of every limb under δ of θ̂
    deviation: float  # standard deviation of its logarithm, the largest of all limbs
    fixed: bool  # whether commands or a known number fix it
    words: str  # its source, in words
    limbs: int  # number of limbs that only the base connects

    @property
    def factor(self) -> float:
        """Half the 95 % interval of the scale, as a factor."""
        return float(np.exp(INTERVAL * self.deviation))

    def judged(self, explains: Explains, sentence: str) -> tuple[Explains, str]:
        """A verdict and its sentence, limited by the scale."""
        if self.fixed or explains == "no":
            return explains, sentence
        each = f" within each of the {self.limbs} limbs" if self.limbs > 1 else ""
        return "partly", (
            f"{sentence} The overall scale rests on {self.words.partition(':')[0]}: ratios of "
            f"parameters hold{each}, absolute values only to a factor of {self.factor:.2g}."
        )


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
    return Scale(slopes[problem.size.limb], deviation, fixed, words, len(slopes))


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
        index = _index(problem, name)
        place = next(p for _, p in space if p.start <= index < p.stop)
        mass = space.geometries[index] == "pseudo_inertia" and index == place.start
        positive = mass or space.geometries[index] == "positive"
        if not np.isfinite(value) or (positive and not value > 0):
            expected = "a number > 0" if positive else "a finite number"
            raise InvalidInput(name, expected, value, f"Its unit is {space.units[index]}.")
        if mass:
            prior[place] *= value / prior[index]  # scale the whole link, which stays physical
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


def _index(problem: FitProblem, name: str) -> int:
    space = problem.space
    names = space.names if name in space.names else space.labels
    if name not in names:
        raise UnknownName("parameter", name, [*space.names, *space.labels])
    return list(names).index(name)


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
        index = _index(problem, name)
        why = "it has no effect in the log"
        share = _share(problem, index)
        members = combined.members(index)
        if index in problem.space.actuators:
            why = "the log hardly couples it to the other parameters"
            why += ", and not at all to those of other limbs" if scale.limbs > 1 else ""
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
            f"absolute values hold to a factor of {scale.factor:.2g}"
        )
        data = {"share": share}
        remedy = _REMEDY.format(" of each limb" if scale.limbs > 1 else "")
        found.append(Finding("warning", "known_in_combination", label, text, remedy, data))
    return found
