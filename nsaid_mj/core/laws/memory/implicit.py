"""Implicit steps of θ̂ on the cost of past data, in the metric of the cone.

A term −κ (∇²ψ)⁻¹ ∇R(θ̂) is added to (45), with R the cost of remembered data (`quotient.cost`), so
that θ̂ converges in every direction that was ever excited. The term acts by implicit steps at
intervals h: θ⁺ is a stationary point of

    κ h [R(θ) + w D_ψ(θ‖θ̂₀)/μ] + D_ψ(θ‖θ̂),

with D_ψ the Bregman divergence of ψ(θ) = ½ θᵀΓ⁻¹θ + μ b(θ), and θ̂₀ the prior. Without the anchor
(w = 0) V decreases for any step size, by the three-point identity (docs/theory.md).
"""

import numpy as np

from ....base import InvalidInput
from ...log import Log, SensorLevels
from ...nullspace.subspace import parts_of
from ...parameters import Array
from ...quotient.cone import inside
from ...quotient.cost import Quotient, Remembered
from ...quotient.descent import Rules, minimise
from ...quotient.matrices import common_root, sandwich_root
from ...structure.system import SecondOrderSystem
from ..base import Confidence, State
from ..cone.law import ConeMetric
from ..settings import MemoryConfig
from .statistics import Memory, Recorder, ResidualView

_RULES = Rules(steps=30, halvings=8, done=1e-6, close=1e-3)  # of Newton's method in a step
_SOLVED = 1e-4  # Newton decrement above which an implicit step counts as not solved
_SHORTER = 0.25  # factor of an unsolved step's length, and how often it is applied
_SHORTENINGS = 6
_SURE = 30.0  # information, in units of the prior's, below which noisy data say nothing: 18 %
_FIRM = 100.0  # weight of the hold, relative to the data, where these are as strong as noise


class ImplicitMemory:
    """A memory of past data, and implicit steps of θ̂ on its cost, in the cone's metric.

    Args:
        system: the structure.
        metric: the cone's.
        prior: (p,) θ̂(0), inside the cone.
        dt: time between measurements [s].
        hermite: cubic Hermite interpolation between samples; else linear.
        config: how past data are kept and used.
        levels: standard deviations of the sensors' noise.

    Attributes:
        every: time steps between two updates of θ̂.
        anchor: weight w of the divergence from the prior relative to the data.
        recorder: updates the statistics of the data.

    Raises:
        InvalidInput: the system has no actuator.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        metric: ConeMetric,
        prior: Array,
        dt: float,
        hermite: bool,
        config: MemoryConfig,
        levels: SensorLevels,
    ):
        if not len(system.space.actuators):
            raise InvalidInput(
                "law",
                "a system with actuators",
                "none",
                "The memory measures residuals relative to the actuators' effort.",
            )
        self.system = system
        self.metric = metric
        self.config = config
        self.prior = prior
        self.recorder = Recorder(system, config, dt, levels, hermite)
        self.anchor = config.weight(self.recorder.exact)
        self.every = self.recorder.every
        self._dt = dt
        self._pace = config.pace * self.every * dt
        self._metric_prior = metric.mirror(prior)[1]
        covariance = np.linalg.inv(self._metric_prior)
        own = parts_of(system) * prior
        if len(own) > 1:  # limbs differ in their scale, too
            covariance += own.T @ own
        self._covariance_prior = np.array(covariance, dtype=np.float64)

    def absorb(self, state: State, log: Log) -> State:
        """The state with a log added to its memory, after an implicit step if one is due."""
        assert state.memory is not None
        return self.updated(state, self.recorder.follow(state.memory, log))

    def updated(self, state: State, memory: Memory) -> State:
        """The state with its memory at a later sample, after an implicit step if one is due."""
        if memory.step % self.every:
            return state._replace(memory=memory)
        start = self._start(state.theta_hat, memory)
        theta, memory = self.implicit_step(start, memory)
        spent = state.spent + self._fall(state.theta_hat, start) + self._cost(start, theta)
        return state._replace(theta_hat=theta, memory=memory, spent=spent)

    def _start(self, theta: Array, memory: Memory) -> Array:
        """(p,) the estimate at which an implicit step starts: θ̂ (p,), or that of the last step.

        It must be inside the cone, which a safeguarded filter's estimate may not be. With noisy
        sensors, (44, 45) also track the noise; if that has increased the cost of the remembered
        data since the last step, the last step's estimate is used.
        """
        view = memory.scores.view
        if not inside(self.metric.cone, theta):
            return self.prior if view is None else view.theta
        if view is None or self.recorder.exact or np.array_equal(view.theta, theta):
            return theta
        remembered = Remembered.of(memory.means, self.system.space)
        if remembered is None:
            return theta
        cost = remembered.weighted(view.theta)
        return view.theta if cost.value(view.theta) < cost.value(theta) else theta

    def implicit_step(self, theta: Array, memory: Memory) -> tuple[Array, Memory]:
        """One implicit step from θ̂ (p,), by Newton's method.

        Returns:
            (p,) θ⁺, which is θ̂ while no actuator has had an effect; and the memory with the view
            that weighs later blocks.
        """
        remembered = Remembered.of(memory.means, self.system.space)
        if remembered is None:
            return theta, memory
        cost = remembered.weighted(theta)
        pace = self._pace
        hold = self._hold(cost, theta, memory)
        for _ in range(_SHORTENINGS):
            ahead = minimise(_Implicit(self, cost, hold, theta, pace), theta, _RULES)
            if ahead.decrement <= _SOLVED:
                theta = ahead.theta
                break
            pace *= _SHORTER
        view = ResidualView(theta, *remembered.residuals(theta))
        return theta, memory._replace(scores=memory.scores._replace(view=view))

    def _hold(self, cost: Quotient, theta: Array, memory: Memory) -> Array:
        """(p, p) curvature of the term that holds θ̂ at the prior in uninformative directions.

        With A the data's information at θ (p,) and B that of a measurement as good as 18 %,
        directions in which B has the share s of A + B are held by 100 (2s)⁶ of A + B: far more than
        by the data where A ≤ B, less than 0.5 % of that where A > 10 B. 0 with exact rows.
        `cost` is R, weighted at θ.
        """
        if not memory.means.noise.any():
            return np.zeros_like(self._metric_prior)
        unsure = _SURE * self._metric_prior
        root, shares = common_root(cost.information(theta) + unsure, unsure)
        return (root * (_FIRM * (2 * np.maximum(shares, 0.0)) ** 6)) @ root.T

    def _root(
        self, remembered: Remembered, theta: Array, memory: Memory, curvature: Array
    ) -> Array:
        """(p, p) root of the covariance of θ̂'s error at θ (p,), at a fixed common scale.

        θ̂ − θ* has approximately the sandwich covariance H⁻¹ S H⁻¹, with H the Hessian of the
        minimised cost at θ̂ and S the covariance of its gradient at θ*: of the sum of the blocks'
        scores, robust to correlation between rows and neighbouring blocks (White, Econometrica 48,
        1980; Newey and West, 1987), plus that of independent residuals, since few blocks leave it
        rank-deficient; of the pull towards the prior; and the square of the bias that inaccurate
        rows cause.
        """
        cost = remembered.weighted(theta)
        data = cost.curvature(theta)
        hold = self._hold(cost, theta, memory)
        pull = hold + max(self.anchor, 1.0) * curvature
        bias = remembered.of_noise(theta).gradient(theta)
        scatter = data + memory.means.blocks * memory.scores.meat + np.outer(bias, bias)
        root = sandwich_root(data + pull, scatter + pull @ self._covariance_prior @ pull)
        efforts = remembered.effort * theta
        scale = np.mean(efforts / (efforts @ theta)[:, None], axis=0)
        root -= np.outer(theta, scale @ root)  # at a fixed scale: θ = 0 would explain all data
        return np.asarray(root, dtype=np.float64)

    def _cost(self, before: Array, after: Array) -> float:
        """Decrease of the conserved quantity in an implicit step: 2 D_ψ(θ⁺‖θ̂) without anchor."""
        if self.anchor:
            return self._fall(before, after)
        return 2 * float(self.metric.divergence(after, before))

    def _fall(self, before: Array, after: Array) -> float:
        """Decrease of the conserved quantity; 0 if it is not finite at the first estimate (p,)."""
        fall = float(self.metric.conserved(before)) - float(self.metric.conserved(after))
        return fall if np.isfinite(fall) else 0.0

    def slack(self, before: State, after: State, theta: Array) -> float:
        """Bound on the rise of V in an update, under the true θ (p,).

        It sums κh/2 R(θ) max_j θ_j/θ̂_j over the actuators j; the hold's form at θ − θ̂₀; with an
        anchor, what V lacks of its value at the prior (M11); and what V gains where the step starts
        at the estimate of the last one.
        """
        memory = after.memory
        remembered = memory and Remembered.of(memory.means, self.system.space)
        if memory is None or memory.step % self.every or remembered is None:
            return 0.0
        cost = remembered.weighted(before.theta_hat)
        k = self.system.space.actuators
        largest = float(np.max(theta[k] / after.theta_hat[k]))
        off = theta - self.prior
        hold = self._hold(cost, before.theta_hat, memory)
        data = 0.5 * (max(0.0, cost.value(theta)) * largest + off @ hold @ off)
        divergence = self.metric.divergence
        recent = memory._replace(scores=before.memory.scores) if before.memory else memory
        start = self._start(before.theta_hat, recent)
        missing = divergence(theta, self.prior) - divergence(theta, start)
        anchor = self.anchor * max(0.0, float(missing)) / self.metric.mu
        back = divergence(theta, start) - divergence(theta, before.theta_hat)
        return float(self.metric.mu * self._pace * (data + anchor) + max(0.0, back))

    def updates(self, t: Array) -> np.ndarray:
        """(N−1,) whether an implicit step lies in (t_k, t_k+1] of the times (N,) of a run."""
        number = np.floor(np.round(t / self._dt) / self.every)
        return np.diff(number) > 0

    def confidence(self, state: State) -> Confidence | None:
        """The covariance at the last implicit step.

        None before the first scores, and where rounding puts θ̂ on the cone's boundary.
        """
        memory = state.memory
        if memory is None or memory.scores.view is None or not memory.scores.count:
            return None
        view = memory.scores.view
        remembered = Remembered.of(memory.means, self.system.space)
        curvature = self.metric.mirror(view.theta)[1]
        if remembered is None or not np.isfinite(curvature).all():
            return None
        root = self._root(remembered, view.theta, memory, curvature)
        samples = memory.means.blocks * (1 - view.rho) / (1 + view.rho)
        return Confidence(root @ root.T, self._covariance_prior, samples)


class _Implicit:
    """The objective of one implicit step, over μ; see the module.

    The memory has the metric, the anchor and the prior, `cost` is R with the weights of this step,
    hold (p, p) the curvature of the term that holds θ̂ at the prior, start (p,) θ̂, and `pace`
    κh/μ.
    """

    def __init__(
        self, memory: ImplicitMemory, cost: Quotient, hold: Array, start: Array, pace: float
    ):
        self.metric = memory.metric
        self.cost = cost
        self.pace = pace
        self.prior = memory.prior
        self.hold = pace * hold
        anchor = pace * memory.anchor
        self.whole = 1 + anchor
        self.dual = self.metric.mirror(start)[0] + anchor * self.metric.mirror(self.prior)[0]

    def value(self, theta: Array) -> float:
        """κh [R(θ) + w D_ψ(θ‖θ̂₀)/μ + the hold]/μ + D_ψ(θ‖θ̂)/μ at θ (p,), up to a constant."""
        total = self.pace * self.cost.value(theta) + self.whole * self.metric.potential(theta)
        off = theta - self.prior
        return float(total - self.dual @ theta + 0.5 * off @ self.hold @ off)

    def gradient(self, theta: Array) -> Array:
        """(p,) of the objective at θ (p,)."""
        return self._gradient(theta, self.metric.mirror(theta)[0])

    def _gradient(self, theta: Array, slope: Array) -> Array:
        pull = self.hold @ (theta - self.prior) + self.whole * slope - self.dual
        return self.pace * self.cost.gradient(theta) + pull

    def derivatives(self, theta: Array) -> tuple[Array, Array]:
        """(p,) gradient and (p, p) Gauss–Newton Hessian at θ (p,)."""
        slope, self._near = self.metric.mirror(theta)
        curvature = self.pace * self.cost.curvature(theta) + self.hold + self.whole * self._near
        return self._gradient(theta, slope), curvature

    def length(self, theta: Array, step: Array) -> float:
        """Length of a step (p,) in the metric ∇²ψ/μ at the θ (p,) of the last derivatives."""
        return float(np.sqrt(step @ self._near @ step))
