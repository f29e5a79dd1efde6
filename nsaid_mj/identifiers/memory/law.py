"""(44) and (45) in the metric of the cone, with a memory of past data.

A term −κ (∇²ψ)⁻¹ ∇R(θ̂) is added to (45), with R the cost of remembered data (`cost`), so that θ̂
converges in every direction that was ever excited. The term acts by implicit steps at intervals h:
θ⁺ is a stationary point of

    κ h [R(θ) + w D_ψ(θ‖θ̂₀)/μ] + D_ψ(θ‖θ̂),

with D_ψ the Bregman divergence of ψ(θ) = ½ θᵀΓ⁻¹θ + μ b(θ), and θ̂₀ the prior. Without the anchor
(w = 0) V decreases for any step size, by the three-point identity (docs/theory.md).
"""

from __future__ import annotations

import numpy as np

from ...errors import InvalidInput
from ...log import EXACT, Log, Measurement, SensorLevels
from ...parameters import Array
from ...system import SecondOrderSystem
from ..base import Confidence, DataMemory, State
from ..cone.law import ConeMetric
from ..nullspace_aid import NullspaceIdentifier
from .cost import Quotient, inverse, quotient
from .statistics import Memory, MemoryConfig, Recorder, Trusted

_REACH = 0.5  # longest Newton step in the metric; the Dikin ellipsoid of radius 1 is in the cone
_NEWTON, _HALVINGS = 30, 8  # iterations, at most, in one implicit step
_CLOSE = 1e-3  # length below which a Newton step is scaled by the gradient, not the objective
_DONE = 1e-7  # length of a Newton step at which the iteration ends
_HINT = 1e-6  # least weight of the prior in the covariance: unobservable directions need one


def memory_identifier(
    system: SecondOrderSystem,
    K: Array,
    Gamma: Array,
    prior: Array,
    dt: float,
    mu: float,
    hermite: bool = True,
    config: MemoryConfig | None = None,
    levels: SensorLevels = EXACT,
) -> NullspaceIdentifier:
    """The identifier of (44, 45) in the cone's metric, with implicit steps on a memory's cost.

    Args:
        system: the structure.
        K: (n,) or (n, n) gain of the identification plant [1/s].
        Gamma: (p,) or (p, p) adaptation gain.
        prior: (p,) θ̂(0), inside the cone.
        dt: time between measurements [s].
        mu: weight μ of the barrier [J]; > 0.
        hermite: cubic Hermite interpolation between samples; else linear.
        config: how past data are kept and used; None is `MemoryConfig()`.
        levels: standard deviations of the sensors' noise.

    Raises:
        InvalidInput: a shape or value is wrong, the prior is outside the cone, or the system has no
            actuator.
    """
    metric = ConeMetric(system.space, Gamma, prior, mu)
    memory = ImplicitMemory(system, metric, prior, dt, hermite, config or MemoryConfig(), levels)
    return NullspaceIdentifier(system, K, metric, prior, dt, hermite, memory)


class ImplicitMemory(DataMemory):
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
        self.system, self.metric, self.config = system, metric, config
        self.anchor = config.weight(levels)
        self.recorder = Recorder(system, config, dt, levels, hermite)
        self.every, self._dt = self.recorder.every, dt
        self._pace = config.pace * self.every * dt
        self._mirror_prior, self._metric_prior = metric.mirror(prior)

    def begin(self, first: Measurement) -> Memory:
        """The empty memory at a first measurement."""
        return self.recorder.begin(first)

    def absorb(self, state: State, log: Log) -> State:
        """The state with a log added to its memory, after an implicit step if one is due."""
        assert state.memory is not None
        memory = self.recorder.follow(state.memory, log)
        if memory.step % self.every:
            return state._replace(memory=memory)
        memory, changed = self.recorder.check_consistency(memory, log.at(-1))
        theta, spent = state.theta_hat, state.spent
        if changed:  # an actuator's gain: back to the estimate before the change
            assert memory.trusted is not None
            theta = memory.trusted.theta
            conserved = self.metric.conserved
            spent += float(conserved(state.theta_hat) - conserved(theta))
        elif not memory.alarmed:
            theta, memory = self.implicit_step(theta, memory)
            spent += self._cost(state.theta_hat, theta)
        return state._replace(theta_hat=theta, memory=memory, spent=spent)

    def implicit_step(self, theta: Array, memory: Memory) -> tuple[Array, Memory]:
        """One implicit step from an estimate, by Newton's method.

        Args:
            theta: (p,) θ̂.
            memory: the statistics of the data.

        Returns:
            (p,) θ⁺, which is θ̂ while no actuator has had an effect; and the memory with the view
            that weighs later blocks.
        """
        remembered = quotient(memory.means, self.system.space)
        if remembered is None:
            return theta, memory
        pace, anchor = self._pace, self._pace * self.anchor
        cost, _ = remembered.weighted(theta, memory)
        dual = self.metric.mirror(theta)[0] + anchor * self._mirror_prior

        def uphill(theta: Array, slope: Array) -> Array:
            return pace * cost.gradient(theta) + (1 + anchor) * slope - dual

        for _ in range(_NEWTON):
            slope, metric = self.metric.mirror(theta)
            gradient = uphill(theta, slope)
            way = -_solve(pace * cost.curvature(theta) + (1 + anchor) * metric, gradient)
            length = float(np.sqrt(way @ metric @ way))
            if not length > _DONE:  # or NaN: the last iterate stands
                break
            if length > _CLOSE:
                way = self._shortened(cost, dual, theta, min(1.0, _REACH / length) * way)
            else:  # differences of the objective are rounding errors here, its gradient is exact
                ahead = uphill(theta + way, self.metric.mirror(theta + way)[0]) @ way
                way = way / (1 + max(0.0, float(ahead / -(gradient @ way))))
            theta = theta + way
            if not way.any():
                break
        view = remembered.view(theta, memory.means)
        trusted = Trusted(theta, cost.plant(theta, self.system.space.actuators))
        return theta, memory._replace(scores=memory.scores._replace(view=view), trusted=trusted)

    def _cost(self, before: Array, after: Array) -> float:
        """Decrease of the conserved quantity in an implicit step: 2 D_ψ(θ⁺‖θ̂) without anchor."""
        if self.anchor:
            return float(self.metric.conserved(before) - self.metric.conserved(after))
        return 2 * float(self.metric.divergence(after, before))

    def slack(self, state: State, theta: Array) -> float:
        """Bound on the rise of V in a step: ½ κ h R(θ) max_j θ_j/θ̂_j over the actuators j."""
        memory = state.memory
        remembered = None if memory is None else quotient(memory.means, self.system.space)
        if memory is None or remembered is None:
            return 0.0
        cost, _ = remembered.weighted(state.theta_hat, memory)
        k = self.system.space.actuators
        largest = float(np.max(theta[k] / state.theta_hat[k]))
        pace = self.metric.mu * self._pace
        return max(0.0, 0.5 * pace * cost.value(theta) * largest)

    def updates(self, t: Array) -> np.ndarray:
        """(N−1,) whether an implicit step lies in (t_k, t_k+1] of the times (N,) of a run."""
        number = np.floor(np.round(t / self._dt) / self.every)
        return np.diff(number) > 0

    def confidence(self, state: State) -> Confidence | None:
        """The covariance of the estimate's error; None before the first scores.

        θ̂ − θ* has approximately the sandwich covariance H⁻¹ (S + w ∇²ψ/μ) H⁻¹, with H the Hessian
        of the minimised cost at θ̂ and S the covariance of the sum of the blocks' scores, robust to
        correlation between rows and neighbouring blocks (White, Econometrica 48, 1980; Newey and
        West, 1987). As few blocks leave S rank-deficient, the covariance of independent residuals
        is added; so is the square of the bias that noise causes beyond first order.
        """
        memory, theta = state.memory, state.theta_hat
        if memory is None or memory.scores.view is None or not memory.scores.count:
            return None
        cost = quotient(memory.means, self.system.space)
        assert cost is not None  # the memory has a view, so an implicit step has had a cost
        _, metric = self.metric.mirror(theta)
        prior = max(self.anchor, _HINT) * metric
        cost, view = cost.weighted(theta, memory)
        bread = inverse(cost.curvature(theta) + prior)
        data = cost.curvature(theta) if cost.seen is None else cost.seen
        blocks, scores = memory.means.blocks, memory.scores
        bias = blocks * scores.bias
        scatter = data + blocks * scores.meat + np.outer(bias, bias)
        return Confidence(
            bread @ (scatter + prior) @ bread,
            inverse(self._metric_prior),
            blocks * (1 - view.rho) / (1 + view.rho),
        )

    def _shortened(self, cost: Quotient, dual: Array, theta: Array, way: Array) -> Array:
        """(p,) the first of way, way/2, way/4 … that decreases the objective; 0 if none does."""
        before = self._objective(cost, dual, theta)
        for _ in range(_HALVINGS):
            if self._objective(cost, dual, theta + way) <= before + 1e-12 * abs(before):
                return way
            way = 0.5 * way
        return 0 * way

    def _objective(self, cost: Quotient, dual: Array, theta: Array) -> float:
        """κ h [R(θ) + w D_ψ(θ‖θ̂₀)/μ]/μ + D_ψ(θ‖θ̂)/μ, up to a constant.

        `dual` (p,) is ∇ψ(θ̂)/μ + κ h w ∇ψ(θ̂₀)/μ.
        """
        psi = self.metric.potential(theta)
        total = self._pace * cost.value(theta) + (1 + self._pace * self.anchor) * psi
        return float(total - dual @ theta)


def _solve(matrix: Array, right: Array) -> Array:
    """(p,) solution with a positive definite matrix, scaled to unit diagonal for conditioning."""
    scale = 1 / np.sqrt(np.diag(matrix))
    return np.linalg.solve(matrix * np.outer(scale, scale), right * scale) * scale
