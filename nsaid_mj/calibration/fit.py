"""The batch fit: the memory's scale-invariant cost of all rows, minimised inside the cone.

    J(θ) = ½ Σ_i N_i log λ_i(θ) + D(θ, θ̂(0)),     λ_i(θ) = θᵀ G_i θ / θᵀ Σ_i θ

with G_i the mean Gramian of the rows of velocity i and Σ_i that of the actuators' effort in them
(`quotient.cost`): the negative log-likelihood of Gaussian residuals relative to the command, with
unknown variance for every velocity. The first sum is the same for θ and 2 θ, so the prior D fixes
the scale of θ. With σ(θ) = wᵀθ / wᵀθ̂(0) the size of the bodies, such as the links' weight along
the log,

    D(θ, θ̂(0)) = D₀(θ/σ, θ̂(0)) + ½ (log σ / δ)²,

where D₀ is the log-determinant divergence for links and other matrices, a normal density of log θ
for positive parameters, and of θ for free ones. D₀(θ, ·) itself would bias the scale: it contains
tr P₀⁻¹P − log det P₀⁻¹P, which over all multiples of P is minimal where tr P₀⁻¹P = 4. A link whose
shape is changed by the log has eigenvalues of P₀⁻¹P on both sides of 1, whose mean grows with the
change; the scale would therefore decrease with the information on shapes. D₀(θ/σ) is the same for
all multiples of θ, so that σ = 1 at the minimum for any rows, unless a known value or a stated
command determines it. Those are not divided by σ.

Gauss–Newton steps, each within half a Dikin ellipsoid and halved until J falls,
keep every estimate physical.
"""

from typing import NamedTuple

import numpy as np

from ..errors import NoEstimate
from ..parameters import Array, ParameterSpace
from ..quotient.barrier import barrier, gradient_and_hessian, local_norm
from ..quotient.cone import cone_of
from ..quotient.cost import Posterior, Quotient, efforts
from ..quotient.descent import Rules
from ..quotient.descent import minimise as descend
from ..quotient.gramians import Sums
from .problem import Problem

_RULES = Rules(steps=200, halvings=12, done=1e-2)


class Fit(NamedTuple):
    """A minimiser of J."""

    theta: Array  # (p,) θ̂
    levels: Array  # (n,) λ_i, mean squared residuals relative to the actuators' effort
    hessian: Array  # (p, p) Gauss–Newton Hessian of J
    cost: float  # J


class Prior:
    """D(θ, θ̂(0)) of a problem, from its `space`, `prior`, `spread`, `known` and `size`."""

    def __init__(self, problem: Problem):
        space, size = problem.space, problem.size
        kinds, self._cone = space.geometries, None
        self._start = problem.prior
        self._matrix = np.flatnonzero((kinds != "positive") & (kinds != "free"))
        self.positive = np.flatnonzero(kinds == "positive")
        self._free = np.flatnonzero(kinds == "free")
        self._precision = np.where(problem.known, 0.0, 1 / problem.spread)
        self._size = size
        self._limb = np.zeros(len(space), dtype=np.intp) if size is None else size.limb
        self._tied = np.zeros(len(space)) if size is None else 1.0 - size.stated
        blocks = tuple(b for b in space.blocks if b.geometry not in ("positive", "free"))
        if blocks:
            self._cone = cone_of(ParameterSpace(blocks))
            start = self._start[self._matrix]
            self._slope = gradient_and_hessian(self._cone, start)[0]
            self._level, self._pull = barrier(self._cone, start), -self._slope * start

    def _of(self, theta: Array) -> tuple[Array, Array]:
        """(s,) logarithms of the sizes of θ over those of θ̂(0), and their derivatives (s, p)."""
        if self._size is None:
            return np.zeros(1), np.zeros((1, len(theta)))
        w = self._size.weights
        return np.log(w @ theta / (w @ self._start)), self._size.slopes(theta)

    def _deviations(self, theta: Array) -> Array:
        """(p + s,) standardised deviations of single parameters and of the sizes."""
        p, changes = len(theta), self._of(theta)[0]
        off, change = np.zeros(p + len(changes)), self._tied * changes[self._limb]
        if self._size is not None:
            off[p:] = changes / self._size.deviation
        at = self.positive
        off[at] = np.log(theta[at] / self._start[at]) - change[at]
        at = self._free
        off[at] = np.exp(-change[at]) * theta[at] - self._start[at]
        off[:p] *= self._precision
        return off

    def _slopes(self, theta: Array) -> Array:
        """(p + s, p) derivatives of the deviations."""
        p, (changes, slopes) = len(theta), self._of(theta)
        rows, change = np.zeros((p + len(changes), p)), self._tied * changes[self._limb]
        slope = self._tied[:, None] * slopes[self._limb]
        if self._size is not None:
            rows[p:] = slopes / self._size.deviation
        at = self.positive
        rows[at, at] = 1 / theta[at]
        rows[at] -= slope[at]
        at = self._free
        share = np.exp(-change[at])
        rows[at, at] = share
        rows[at] -= (share * theta[at])[:, None] * slope[at]
        rows[:p] *= self._precision[:, None]
        return rows

    def value(self, theta: Array) -> float:
        """D(θ, θ̂(0)); infinite outside the cone."""
        outside = not (theta[self.positive] > 0).all()
        if outside or (self._size is not None and not (self._size.weights @ theta > 0).all()):
            return np.inf
        off = self._deviations(theta)
        total = 0.5 * float(off @ off)
        if self._cone is not None:
            own, change = theta[self._matrix], self._of(theta)[0][self._limb[self._matrix]]
            total += barrier(self._cone, own) - self._level
            total += self._pull @ (change - 1) - self._slope @ (own / np.exp(change))
        return float(total)

    def derivatives(self, theta: Array) -> tuple[Array, Array]:
        """(p,) gradient and (p, p) positive semidefinite Gauss–Newton Hessian of D at θ (p,).

        Only the sizes and stated values have a part along θ.
        """
        off, rows = self._deviations(theta), self._slopes(theta)
        gradient, hessian = rows.T @ off, rows.T @ rows
        if self._cone is not None:
            at, own = self._matrix, theta[self._matrix]
            slope, curvature = gradient_and_hessian(self._cone, own)
            changes, slopes = self._of(theta)
            size, weights = np.exp(changes[self._limb[at]]), slopes[self._limb[at]]
            gradient[at] += slope - self._slope / size
            gradient += (self._pull + self._slope * own / size) @ weights
            shape = np.zeros((len(at), len(theta)))
            shape[:, at] = np.eye(len(at))
            shape -= own[:, None] * weights
            hessian += shape.T @ curvature @ shape
        return gradient, hessian

    def length(self, theta: Array, step: Array) -> float:
        """Length of a step (p,) in the cone's metric at θ: shorter than 1, it stays inside."""
        total = float(np.sum((step[self.positive] / theta[self.positive]) ** 2))
        if self._cone is not None:
            total += local_norm(self._cone, theta[self._matrix], step[self._matrix]) ** 2
        return float(np.sqrt(total))


def gramians(problem: Problem) -> Sums:
    """The Gramians of a problem's usable rows."""
    return Sums.of(problem.Y, problem.usable)


def cost_of(problem: Problem, parts: Sums) -> Quotient:
    """R with weights N_i; raises `NoEstimate` if no command affects the motion.

    Residuals of a passive joint are relative to its inertial force at its rms acceleration:
    relative to the other joints' commands, they could be made 0 by a massless link.
    """
    means, space, inertia = parts.means, problem.space, problem.inertia
    effort = efforts(means, space)
    if effort is None:
        raise NoEstimate("No command has an effect on the motion", "Check the columns of u.")
    if inertia is not None:
        passive = ~means[:, space.actuators, space.actuators].any(axis=1)
        effort = effort[:, :, None] * np.eye(len(space))
        effort[passive] = inertia[passive, :, None] * inertia[passive, None]
    return Quotient(means, effort, parts.counts)


def posterior(problem: Problem, parts: Sums) -> Posterior:
    """J of a problem with the given Gramians of its rows."""
    return Posterior(cost_of(problem, parts), Prior(problem))


def minimise(problem: Problem, parts: Sums | None = None, start: Array | None = None) -> Fit:
    """Minimises J from `start` (p,), by default the prior, with the Gramians `parts` or all rows.

    Raises:
        NoEstimate: there are no usable rows, or the prior is not physical.
    """
    parts = gramians(problem) if parts is None else parts
    if not parts.counts.any():
        raise NoEstimate("The log has no row in which the robot moves", "Record a motion.")
    J, theta = posterior(problem, parts), problem.prior.copy() if start is None else start.copy()
    if not np.isfinite(J.value(theta)):
        raise NoEstimate("The prior is not physically consistent", "Check the model's inertias.")
    free = np.diag(np.abs(problem.space.scale))[:, ~problem.known]
    theta, _, hessian = descend(J, theta, _RULES, free)
    return Fit(theta, J.quotient.levels(theta), hessian, J.value(theta))
