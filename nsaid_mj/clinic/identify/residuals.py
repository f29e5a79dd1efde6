"""Tests residuals for unmodelled effects, and computes the bias that these cause in the estimate.

A suspect is a set of columns Z that the rows may lack. Its coefficients γ are those of least
squares over all parameters without a prior, so that residuals caused by the prior are not
attributed to it. In the fit they would move the estimate by one Gauss–Newton step,

    δ = −H⁻¹ Xᵀ Z γ/σ²,     X the fit's columns, σ² the variance of the residuals, H the Hessian,

the influence of a specification error (Newey, Maximum likelihood specification testing and
conditional moment tests, Econometrica 53(5), 1985). As residuals are correlated, the significance
of γ is computed from the variance of the scores' sums over blocks in time. Suspects are added by
forward selection, the one that explains most first, until no other is significant.

Sensor noise enters both residuals and Z, which therefore correlate even without an effect. With
independent noise of the same variance added to both, that part of the score s doubles in s': 2 s −
s' is free of it (simulation extrapolation; Cook and Stefanski, Journal of the American Statistical
Association 89(428), 1994). Other noise is not known to be that of the motion or of the commands. A
suspect that can be computed from either therefore counts by the score, of both, that is closer to
0, and by 0 if they differ in sign: one of them is free of the noise. Its size is that of the
columns which do not contain the residual itself; with it, they would explain anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.special

from ...base import Finding
from ...core import Array, Indices, ParameterSpace
from ...lab import INTERVAL
from .fit import Precision, cost_of, gramians
from .problem import FitProblem, mean_squares

_BLOCKS = 20  # of the log, for the variance of the scores
_CHANCE = 0.01  # that any suspect enters by chance
_EVEN = 0.01  # level of significance of the blocks' test
_MOST = 8  # suspects that enter
_MANY = 10_000  # rows of a longer log are thinned, as all of them would fill the memory
_STATED = 0.5  # relative half-width below which a parameter's value counts as known
_NOTED = 0.1  # share of the residuals' variance that is reported
_MOVED = 0.1  # relative shift of such a parameter that is reported
_EXPLAINED = 0.1  # rms of what a suspect explains, over the command's standard deviation
_LITTLE = 0.5  # share of a column outside the fit below which its projection is repeated
_OUTSIDE = 1e-3  # least share of a suspect's columns outside the span of the fit's own
_SPAN = 1e-10  # of the largest information, below which a direction of θ is not in the rows


class Suspect(NamedTuple):
    """An effect that the structure lacks."""

    words: str  # what the residual correlates with, such as "its acceleration"
    where: str  # the joint; "" if it concerns all
    columns: Array  # (N, n, c) its contribution to the rows, up to c unknown coefficients
    remedy: str  # what to do about it
    size: Callable[[float], str] | None = None  # in words, if γ has a meaning and is positive
    # (N, n, c) the same computed from the other of motion and commands; None if there is no other
    other: Array | None = None
    most: float = np.inf  # largest |γ| of the first column that can be
    least: float = 0.0  # smallest γ for which a column holds that was computed at γ = 1
    part: str = ""  # of the joint that has the effect: of one part, one effect is named

    @property
    def cause(self) -> tuple[str, str]:
        """What it has in common with suspects of which only one is named."""
        return self.part or self.words, self.where

    def possible(self, coefficients: Array) -> bool:
        """Whether its coefficients γ (c,) can be: of the right sign and size."""
        first = coefficients[0]
        sign = self.size is None or first > 0
        return bool(sign and self.least <= abs(first) <= self.most)

    def thinned(self, rows: Indices) -> Suspect:
        """The suspect in some of the rows."""
        other = None if self.other is None else self.other[rows]
        return self._replace(columns=self.columns[rows], other=other)


class Followed(NamedTuple):
    """A suspect with which the residuals correlate significantly."""

    suspect: Suspect
    share: Array  # (n,) share of the residuals' variance that it explains
    shift: Array  # (p,) the bias that it causes in θ̂, shrunk by the part due to chance
    coefficients: Array  # (c,) γ of its columns


def followed(
    problem: FitProblem,
    theta: Array,
    covariance: Array,
    share: Array,
    suspects: Iterable[Suspect],
    noisier: Callable[[Array], tuple[FitProblem, Iterable[Suspect]]] | None = None,
) -> tuple[Followed, ...]:
    """The suspects with which the residuals of a fit correlate, in order of selection.

    At θ̂ (p,), `covariance` (p, p) is that under the fit's own structure, H⁻¹, and share (n,) are
    the rows per effectively independent row. Of the suspects of a long log, only some rows are
    kept. `noisier` gives rows and suspects at θ (p,) of the same motion with twice the variance of
    the sensors' noise; it is None if suspects do not depend on the measured motion.
    """
    every = -(-len(problem.t) // _MANY)
    thin = np.arange(0, len(problem.t), every)
    share = share / every
    own = _Rows(problem.select(thin) if every > 1 else problem, theta, share)
    copies = [own]
    left = [(s, [own.outside(s, s)]) for s in (suspect.thinned(thin) for suspect in suspects)]
    level = _CHANCE / max(len(left), 1)
    entered: list[tuple[Suspect, float, Array]] = []
    whole = np.where(own.power > 0, own.power, 1.0)
    while left and len(entered) < _MOST:
        trials = [_trial(copies, *each) for each in left]
        beyond = [trial.beyond(level) for trial in trials]
        if not any(beyond):
            break
        if noisier and copies == [own]:
            other, again = noisier(theta)
            copies.append(_Rows(other.select(thin), theta, share, own.weight))
            for (suspect, rest), noisy in zip(left, again, strict=True):
                rest.append(copies[1].outside(noisy.thinned(thin), suspect))
            continue
        best = max(np.flatnonzero(beyond), key=lambda i: trials[i].gained)
        suspect = left[best][0]
        if not suspect.possible(
            own.coefficients([*(s.columns for s, *_ in entered), suspect.columns])[-1]
        ):
            del left[best]
            continue
        bases = trials[best].bases
        before = own.power
        for copy, basis in zip(copies, bases, strict=True):
            copy.residual = _outside(copy.residual, basis)
        entered.append((suspect, beyond[best], (before - own.power) / whole))
        left = [  # other sizes or places of the encoder of the same effect are not tried
            (s, [_outside(*pair) for pair in zip(rest, bases, strict=True)])
            for s, rest in left
            if s.cause != suspect.cause
        ]
    found = []
    if not entered:
        return ()
    columns = [suspect.columns for suspect, _, _ in entered]
    coefficients = own.coefficients(columns)
    for (suspect, certain, explained), Z, gamma in zip(entered, columns, coefficients, strict=True):
        if not suspect.possible(gamma):  # with the others
            continue
        pull = own.X_T @ own.weighed(Z)
        shift = _bounded(-covariance @ (pull @ gamma), theta, problem.space)
        found.append(Followed(suspect, explained, certain * shift, gamma))
    return tuple(found)


def widened(exact: Precision, left: Sequence[Followed]) -> Precision:
    """The precision with every shift added as one more standard deviation."""
    shifts = [each.shift[None] for each in left]
    return exact._replace(structure=np.vstack([exact.structure, *shifts]))


def doubts(
    problem: FitProblem, exact: Precision, left: Sequence[Followed], held_out: Array
) -> list[Finding]:
    """Findings about the suspects: a warning for each that matters, a note for every other.

    It matters if it explains much of the command itself, or biases a parameter by more than its
    stated interval. Frictions and offsets do not count: most suspects consist of unmodelled parts
    of them, and their intervals are widened. held_out (n,) is the NRMSE of held-out parts; `exact`
    is the precision before it is widened.
    """
    half = INTERVAL * exact.deviation
    space = problem.space
    size = _sizes(exact.theta, space)
    friction = ["friction" in block.name for block in space.blocks for _ in block.names]
    certain = (space.geometries != "free") & ~np.array(friction)
    stated = ~problem.known & certain & (half < _STATED * size)
    findings = []
    for suspect, share, shift, coefficients in left:
        worst = int(np.argmax(np.where(stated, np.abs(shift) / size, 0.0)))
        moved = float(abs(shift[worst]) / size[worst]) if stated[worst] else 0.0
        explained = float(np.sqrt(np.nanmax(np.maximum(share, 0) * held_out**2)))
        beyond = moved > _MOVED and abs(shift[worst]) > half[worst]
        label = space.labels[worst]
        if not beyond and explained <= _EXPLAINED and share.max() < _NOTED:
            continue
        amount = f", {suspect.size(coefficients[0])}" if suspect.size else ""
        words = f"; {label} may be off by {100 * moved:.0f} %" if moved > 0.01 else ""
        if moved >= 1:
            words = f", from which {label} cannot be told apart"
        level = "warning" if beyond or explained > _EXPLAINED else "note"
        part = f"{100 * share.max():.0f} % of the residuals' variance"
        text = f"{part} correlates with {suspect.words}{amount}{words}"
        data = {"share": float(share.max()), "moved": moved, "parameter": label}
        findings.append(Finding(level, "residuals", suspect.where, text, suspect.remedy, data))
    return findings


def _sizes(theta: Array, space: ParameterSpace) -> Array:
    """(p,) sizes of parameters: of moments the largest of a body, as single ones depend on axes."""
    size = np.maximum(np.abs(theta), 1e-300)
    units = np.array(space.units)
    for block, rows in space:
        if block.geometry == "pseudo_inertia":
            own = size[rows]
            for unit in np.unique(units[rows]):
                own[units[rows] == unit] = own[units[rows] == unit].max()
    return size


def _bounded(shift: Array, theta: Array, space: ParameterSpace) -> Array:
    """(p,) a shift by no more than the parameters' own sizes, but for those of either sign.

    A suspect that the fit's columns nearly make up would shift them by many times that, which is
    beyond what one linear step can tell: it says that they are not determined. Bodies are shifted
    together, so that what the log tells of their sum remains.
    """
    kinds = space.geometries
    size = np.where(kinds == "free", np.inf, _sizes(theta, space))
    body = (kinds != "free") & (kinds != "positive")
    most = float(np.max(np.abs(shift[body]) / size[body], initial=1.0))
    return np.where(body, shift / most, np.clip(shift, -size, size))


class _Trial(NamedTuple):
    """The effect of adding a suspect."""

    # (N n, c) orthonormal bases of its columns orthogonal to those of the fit, in every copy
    bases: list[Array]
    gained: float  # decrease of the weighted sum of squares
    F: float  # Hotelling's statistic
    degrees: tuple[int, int]  # degrees of freedom of F

    def beyond(self, level: float) -> float:
        """Shrinkage factor of the coefficients; 0 unless both tests are significant.

        One test counts rows as effectively independent ones, at the level of significance; the
        other uses the blocks, which are few and uneven, at 1 %.
        """
        chance = 2 * scipy.special.gammainccinv(0.5 * max(self.bases[0].shape[1], 1), level)
        if self.gained < chance or scipy.special.fdtri(*self.degrees, 1 - _EVEN) > self.F:
            return 0.0
        return 1 - 1 / self.F


class _Rows:
    """Weighted rows of a fit: as measured, or a copy with the noise doubled.

    Attributes:
        X_T: (p, N n) transposed columns of the fit: changes of the residuals over the effort.
        weight: (N, n) weight of the rows.
        residual: (N n, 1) what fit and selected suspects leave.
    """

    def __init__(
        self, problem: FitProblem, theta: Array, share: Array, weight: Array | None = None
    ):
        used = problem.usable
        residual = np.where(used, problem.residual(theta), 0.0)
        power = mean_squares(residual, used)
        own = used / np.sqrt(np.where(power > 0, power, np.inf) * share)
        self.weight = own if weight is None else weight
        cost = cost_of(problem, gramians(problem))
        scaled = cost.pull(theta) / cost.efforts(theta)[:, None]  # as residuals are relative to u
        X = (problem.Y - residual[:, :, None] * scaled) * self.weight[:, :, None]
        self.X_T = X.reshape(-1, len(theta)).T
        unit = self.X_T * problem.space.scale[:, None]
        values, vectors = scipy.linalg.eigh(unit @ unit.T)
        kept = values > _SPAN * values[-1]
        self._own = unit.T @ (vectors[:, kept] / np.sqrt(values[kept]))
        self._first = _outside((residual * self.weight).reshape(-1, 1), self._own)
        self.residual = self._first
        self.n = used.shape[1]

    def weighed(self, columns: Array) -> Array:
        """(N n, c) columns (N, n, c) times the rows' weights."""
        return (columns * self.weight[:, :, None]).reshape(-1, columns.shape[2])

    def outside(self, suspect: Suspect, unit: Suspect) -> Array:
        """(N n, c or 2 c) a suspect's columns orthogonal to the fit's, over lengths of `unit`'s.

        Those computed otherwise follow if there are any.
        """
        length = np.maximum(np.linalg.norm(self.weighed(unit.columns), axis=0), 1e-300)
        every = [suspect.columns, *([] if suspect.other is None else [suspect.other])]
        return _outside(np.hstack([self.weighed(each) / length for each in every]), self._own)

    @property
    def power(self) -> Array:
        """(n,) sums of squares of the residuals."""
        return np.sum(self.residual.reshape(-1, self.n) ** 2, axis=0)

    def coefficients(self, suspects: list[Array]) -> list[Array]:
        """γ of the columns (N, n, c) of all suspects in a joint fit."""
        Z = np.hstack([self.weighed(columns) for columns in suspects])
        size = np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
        rest = _outside(Z / size, self._own)
        gamma = -np.linalg.lstsq(rest, self._first[:, 0], rcond=_OUTSIDE)[0] / size
        return np.split(gamma, np.cumsum([columns.shape[2] for columns in suspects])[:-1])


def _trial(copies: list[_Rows], suspect: Suspect, rest: list[Array]) -> _Trial:
    """The effect of a suspect, with columns `rest` orthogonal to the fit's in every copy.

    They are (N n, c), or (N n, 2 c) with those computed otherwise. Of two copies, scores are
    extrapolated to no noise.
    """
    c = suspect.columns.shape[2]
    values, vectors = scipy.linalg.eigh(rest[0][:, :c].T @ rest[0][:, :c])
    kept = values > _OUTSIDE
    combine = vectors[:, kept] / np.sqrt(values[kept])
    bases = [columns[:, :c] @ combine for columns in rest]
    scores = _extrapolated([basis * x.residual for basis, x in zip(bases, copies, strict=True)])
    if suspect.other is not None:
        again = [r[:, c:] @ combine * x.residual for r, x in zip(rest, copies, strict=True)]
        scores = _closer_to_zero(scores, _extrapolated(again))
    gained = scores.sum(axis=0)
    impossible = suspect.size is not None and (combine @ gained > 0).any()
    if not kept.any() or impossible:
        return _Trial([basis[:, :0] for basis in bases], 0.0, 0.0, (1, 1))
    F, degrees = _hotelling(scores.reshape(-1, copies[0].n, scores.shape[1]).sum(axis=1))
    bases = [bases[0], *(np.linalg.qr(basis)[0] for basis in bases[1:])]
    return _Trial(bases, float(np.sum(gained**2)), F, degrees)


def _extrapolated(scores: list[Array]) -> Array:
    """The scores (N n, c) without noise, from those as measured and, if any, with noise doubled."""
    return scores[0] if len(scores) == 1 else 2 * scores[0] - scores[1]


def _closer_to_zero(scores: Array, others: Array) -> Array:
    """(N n, c) the mixture of two kinds of scores whose sums are closest to 0."""
    own = scores.sum(axis=0)
    change = np.where(own == others.sum(axis=0), 1.0, own - others.sum(axis=0))
    return scores + np.clip(own / change, 0.0, 1.0) * (others - scores)


def _outside(Z: Array, basis: Array) -> Array:
    """Z (N n, c) minus its projection on a basis; done twice if the rest is small, for rounding."""
    rest = Z - basis @ (basis.T @ Z)
    little = np.linalg.norm(rest, axis=0) < _LITTLE * np.linalg.norm(Z, axis=0)
    if little.any():
        some = rest[:, little]
        rest[:, little] = some - basis @ (basis.T @ some)
    return rest


def _hotelling(scores: Array) -> tuple[float, tuple[int, int]]:
    """Hotelling's F of the mean of block sums of scores (N, c), and its degrees of freedom."""
    c = scores.shape[1]
    if len(scores) < 2 * _BLOCKS or not c:
        return 0.0, (1, 1)
    blocks = np.add.reduceat(scores, np.arange(_BLOCKS) * len(scores) // _BLOCKS, axis=0)
    mean = blocks.mean(axis=0)
    spread = np.atleast_2d(np.cov(blocks, rowvar=False))
    T2 = _BLOCKS * float(mean @ np.linalg.lstsq(spread, mean, rcond=None)[0])
    return T2 * (_BLOCKS - c) / (c * (_BLOCKS - 1)), (c, _BLOCKS - c)
