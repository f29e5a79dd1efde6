"""The common scale of θ, which no motion reveals: its source and its uncertainty.

With all masses, frictions and gains doubled, the motion is the same. A known number, such as a
motor's gain, fixes the scale if the log couples it to all other parameters; so do commands stated
in N·m or N. Otherwise the scale comes from the model file's masses.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import InvalidInput, UnknownName
from ..evaluation.confidence import INTERVAL
from ..evaluation.result import Explains
from ..parameters import Array
from ..robot.findings import Finding
from .precision import Precision, combinations
from .problem import Problem
from .statements import in_words

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
    problem: Problem, exact: Precision, theta: Array, stated: bool, weightless: bool,
    known: Mapping[str, float],
) -> Scale:  # fmt: skip
    """The common scale of the estimate θ̂ (p,) of a problem.

    `stated` is whether commands are in N·m or N, `weightless` whether the model file has no masses,
    `known` the user's parameters.
    """
    at, size = problem.space.actuators, problem.size
    gains = exact.deviation[at] / np.abs(theta[at])
    if size is None:
        slopes, limb = np.zeros((1, len(theta))), np.zeros(len(theta), dtype=np.intp)
        slopes[0, at] = 1 / (len(at) * theta[at])
    else:
        slopes, limb = size.slopes(theta), size.limb
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
    return Scale(slopes[limb], deviation, fixed, words, len(slopes))


def with_known(problem: Problem, known: Mapping[str, float]) -> Problem:
    """The problem with parameters held at known values.

    The prior shape of a link of known mass is the file's, and it contributes to the size.

    Raises:
        UnknownName: there is no such parameter.
        InvalidInput: a value is not finite, or not positive where it must be.
    """
    prior, fixed, space = problem.prior.copy(), problem.known.copy(), problem.space
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
        prior[index], fixed[index] = value, True
    return replace(problem, prior=prior, known=fixed)


def _share(problem: Problem, index: int) -> float:
    """Share of the bodies' size due to the body whose mass a parameter is; 0 for others."""
    own = next(p for _, p in problem.space if p.start <= index < p.stop)
    if problem.size is None or problem.space.units[index] != "kg" or index != own.start:
        return 0.0
    parts = problem.size.weights[problem.size.limb[index]] * problem.prior
    return float(np.clip(parts[own].sum() / parts.sum(), 0.0, 1.0))


def _index(problem: Problem, name: str) -> int:
    space = problem.space
    names = space.names if name in space.names else space.labels
    if name not in names:
        raise UnknownName("parameter", name, [*space.names, *space.labels])
    return list(names).index(name)


def rescaled(problem: Problem, known: Mapping[str, float]) -> Problem:
    """The problem of a model without masses, with its arbitrary scale moved to known values."""
    given = with_known(problem, known).prior
    at = np.flatnonzero((given != problem.prior) & (given > 0) & (problem.prior > 0))
    if not len(at):
        return problem
    factor = float(np.exp(np.mean(np.log(given[at] / problem.prior[at]))))
    free = problem.space.geometries == "free"
    spread = np.where(free, factor * problem.spread, problem.spread)
    return replace(problem, prior=factor * problem.prior, spread=spread)


def idle_values(problem: Problem, scale: Scale, known: Mapping[str, float]) -> list[Finding]:
    """Reports known values that do not fix the scale: their effect, and the reason."""
    if scale.fixed:
        return []
    combined, found = combinations(problem), []
    for name, value in known.items():
        index, why = _index(problem, name), "it has no effect in the log"
        share, members = _share(problem, index), combined.members(index)
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
