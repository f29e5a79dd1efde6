"""(44) and (45) in the metric of the cone, and a memory: θ̂ converges to what was ever excited.

To (45) a term −κ (∇²ψ)⁻¹ ∇R(θ̂) is added, R the quotient of remembered data. It acts by implicit
steps, every now and then: θ⁺ makes

    κ h [R(θ) + w D_ψ(θ‖θ̂₀)/μ] + D_ψ(θ‖θ̂)

stationary, D_ψ the Bregman divergence of ψ(θ) = ½ θᵀΓ⁻¹θ + μ b(θ) and θ̂₀ the prior. Without the
anchor (w = 0) V falls at any step size, by the three-point identity (docs/theory.md).
"""

from __future__ import annotations

import numpy as np

from ...errors import InvalidInput
from ...log import EXACT, Log, Measurement, SensorLevels
from ...parameters import Array
from ...system import SecondOrderSystem
from ..base import Confidence, Estimates, State, Status
from ..cone.barrier import barrier, gradient_and_hessian
from ..cone.law import ConeIdentifier
from .cost import Quotient, inverse, quotient
from .statistics import Memory, MemoryConfig, Recorder, Trusted

_REACH = 0.5  # of a Newton step in the metric: a Dikin ellipsoid lies inside the cone up to 1
_NEWTON, _HALVINGS = 30, 8  # at most, in one implicit step
_CLOSE = 1e-3  # a Newton step this short is judged by its slope
_DONE = 1e-7  # … and this short ends it
_HINT = 1e-6  # weight of the prior, at least, in what is said of the unobservable


class MemoryIdentifier(ConeIdentifier):
    """(44), (45) in the cone's metric, and implicit steps down the memory's cost.

    Args:
        system: the structure.
        K: (n,) or (n, n) gain of the identification plant [1/s].
        Gamma: (p,) or (p, p) adaptation gain.
        prior: (p,) θ̂(0), inside the cone.
        dt: time between measurements [s].
        mu: weight μ of the barrier [J]; > 0.
        hermite: how the state between samples is had.
        config: of the memory.
        levels: of the sensors' noise.

    Raises:
        InvalidInput: as for the base class; or a system has no actuator.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        K: Array,
        Gamma: Array,
        prior: Array,
        dt: float,
        mu: float,
        hermite: bool = True,
        config: MemoryConfig | None = None,
        levels: SensorLevels = EXACT,
    ):
        super().__init__(system, K, Gamma, prior, dt, mu, hermite)
        if not len(system.space.actuators):
            raise InvalidInput(
                "law", "a system with actuators", "none", "The memory measures in shares of them."
            )
        self.config = config or MemoryConfig()
        self.anchor = self.config.weight(levels)
        self.recorder = Recorder(system, self.config, dt, levels, hermite)
        self._dt, self._every = dt, self.recorder.every
        self._pace = self.config.pace * self._every * dt
        whole = self._inverse_gain if self.Gamma.ndim == 2 else np.diag(self._inverse_gain)
        self._stiffness = whole / self.mu
        self._mirror_prior, self._metric_prior = self._mirror(self.prior)

    def init(self, first: Measurement) -> State:
        """As in the base class, with a memory of nothing."""
        state = super().init(first)
        return state._replace(memory=self.recorder.begin(first))

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """RK4 steps of (44, 45) along a log and, whenever it is time, an implicit step."""
        made, at = [Estimates.of(state)], 0
        while at < len(log.t) - 1 and state.status is Status.completed:
            assert state.memory is not None
            steps = self._every - state.memory.step % self._every
            piece = log.part(at, at + steps + 1)
            state, estimates = super().follow(state, piece)
            if state.status is Status.completed:
                state = self._remember(state, piece)
                estimates.theta_hat[-1], estimates.spent[-1] = state.theta_hat, state.spent
            made.append(estimates.after(1))
            at += len(estimates.pivot) - 1
        return state, Estimates(*(np.concatenate(part) for part in zip(*made, strict=True)))

    def _remember(self, state: State, log: Log) -> State:
        """Takes a log into the memory; then, if it is time, an implicit step."""
        assert state.memory is not None
        memory = self.recorder.follow(state.memory, log)
        if memory.step % self._every:
            return state._replace(memory=memory)
        memory, changed = self.recorder.doubt(memory, log.at(-1))
        theta, spent = state.theta_hat, state.spent
        if changed:  # an actuator has
            assert memory.trusted is not None
            theta = memory.trusted.theta
            spent += float(self.conserved(state.theta_hat) - self.conserved(theta))
        elif not memory.alarmed:
            theta, memory = self.settle(theta, memory)
            spent += self._cost(state.theta_hat, theta)
        return state._replace(theta_hat=theta, memory=memory, spent=spent)

    def settle(self, theta: Array, memory: Memory) -> tuple[Array, Memory]:
        """(p,) θ⁺ after an implicit step from θ̂, and the memory with its view of what comes next.

        θ̂ itself where the memory says nothing yet.
        """
        remembered = quotient(memory.means, self.system.space)
        if remembered is None:
            return theta, memory
        pace, anchor = self._pace, self._pace * self.anchor
        cost, _ = remembered.weighted(theta, memory)
        dual = self._mirror(theta)[0] + anchor * self._mirror_prior

        def uphill(theta: Array, slope: Array) -> Array:
            return pace * cost.gradient(theta) + (1 + anchor) * slope - dual

        for _ in range(_NEWTON):
            slope, metric = self._mirror(theta)
            gradient = uphill(theta, slope)
            way = -_solve(pace * cost.curvature(theta) + (1 + anchor) * metric, gradient)
            length = float(np.sqrt(way @ metric @ way))
            if not length > _DONE:  # NaN too: what was reached stands
                break
            if length > _CLOSE:
                way = self._shortened(cost, dual, theta, min(1.0, _REACH / length) * way)
            else:  # the objective cannot tell any more, its slope can
                ahead = uphill(theta + way, self._mirror(theta + way)[0]) @ way
                way = way / (1 + max(0.0, float(ahead / -(gradient @ way))))
            theta = theta + way
            if not way.any():
                break
        view = remembered.view(theta, memory.means)
        trusted = Trusted(theta, cost.plant(theta, self.system.space.actuators))
        return theta, memory._replace(scores=memory.scores._replace(view=view), trusted=trusted)

    def _cost(self, before: Array, after: Array) -> float:
        """What an implicit step takes from the conserved quantity: 2 D_ψ(θ⁺‖θ̂), if unanchored."""
        if self.anchor:
            return float(self.conserved(before) - self.conserved(after))
        return 2 * float(self.divergence(after, before))

    def slack(self, state: State, theta: Array) -> float:
        """½ κ h R(θ) max_j θ_j/θ̂_j over the actuators, the most that a step can raise V by."""
        memory = state.memory
        remembered = None if memory is None else quotient(memory.means, self.system.space)
        if memory is None or remembered is None:
            return 0.0
        cost, _ = remembered.weighted(state.theta_hat, memory)
        k = self.system.space.actuators
        largest = float(np.max(theta[k] / state.theta_hat[k]))
        pace = self.mu * self._pace
        return max(0.0, 0.5 * pace * cost.value(theta) * largest)

    def implicit(self, t: Array) -> np.ndarray:
        """Whether an implicit step lies in (t_k, t_k+1] of times (N,) on the run's grid."""
        number = np.floor(np.round(t / self._dt) / self._every)
        return np.diff(number) > 0

    def confidence(self, state: State) -> Confidence | None:
        """What is known of the estimate's error; None as long as the memory says nothing.

        θ̂ − θ* has about the covariance H⁻¹ (S + w ∇²ψ/μ) H⁻¹, H the curvature of what is least at
        θ̂ and S the scatter of the blocks' scores, in which rows and neighbouring blocks may be
        correlated (White, Econometrica 48, 1980; Newey and West, 1987). Few blocks leave some
        directions of S empty, so what independent ones would have is added; and so is the
        square of the bias that noise gives where it enters a regressor beyond first order.
        """
        memory, theta = state.memory, state.theta_hat
        if memory is None or memory.scores.view is None or not memory.scores.count:
            return None
        cost = quotient(memory.means, self.system.space)
        assert cost is not None  # there was a view
        _, metric = self._mirror(theta)
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
        """The first of way, way/2, way/4 … that lowers what an implicit step makes least; or 0."""
        before = self._objective(cost, dual, theta)
        for _ in range(_HALVINGS):
            if self._objective(cost, dual, theta + way) <= before + 1e-12 * abs(before):
                return way
            way = 0.5 * way
        return 0 * way

    def _objective(self, cost: Quotient, dual: Array, theta: Array) -> float:
        """κ h [R(θ) + w D_ψ(θ‖θ̂₀)/μ]/μ + D_ψ(θ‖θ̂)/μ, less what does not depend on θ.

        `dual` is ∇ψ(θ̂)/μ + κ h w ∇ψ(θ̂₀)/μ.
        """
        psi = 0.5 * theta @ self._stiffness @ theta + barrier(self.cone, theta)
        total = self._pace * cost.value(theta) + (1 + self._pace * self.anchor) * psi
        return float(total - dual @ theta)

    def _mirror(self, theta: Array) -> tuple[Array, Array]:
        """(p,) ∇ψ(θ)/μ and (p, p) ∇²ψ(θ)/μ."""
        slope, metric = gradient_and_hessian(self.cone, theta)
        return self._stiffness @ theta + slope, self._stiffness + metric


def _solve(matrix: Array, right: Array) -> Array:
    """(p,) solves with a positive definite matrix whose entries differ by many orders of size."""
    scale = 1 / np.sqrt(np.diag(matrix))
    return np.linalg.solve(matrix * np.outer(scale, scale), right * scale) * scale
