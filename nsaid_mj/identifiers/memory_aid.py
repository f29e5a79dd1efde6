"""(44) and (45) in the metric of the cone, and a memory: θ̂ converges to what was ever excited.

To (45) a term −κ (∇²ψ)⁻¹ ∇R(θ̂) is added, R the quotient of remembered data. It acts by implicit
steps, every now and then: θ⁺ makes

    κ h [R(θ) + w D_ψ(θ‖θ̂₀)/μ] + D_ψ(θ‖θ̂)

stationary, D_ψ the Bregman divergence of ψ(θ) = ½ θᵀΓ⁻¹θ + μ b(θ) and θ̂₀ the prior. Without the
anchor (w = 0) V falls at any step size, by the three-point identity (docs/theory.md).
"""

from __future__ import annotations

import numpy as np

from ..cone import gradient_and_hessian
from ..errors import InvalidInput
from ..parameters import Array
from ..system import EXACT, Measurement, SecondOrderSystem, SensorLevels
from .base import Confidence, State, Status
from .cone_aid import ConeIdentifier
from .memory import Memory, MemoryConfig, Recorder, Trusted
from .quotient import Quotient, quotient

_REACH = 0.5  # of a Newton step in the metric: a Dikin ellipsoid lies inside the cone up to 1
_NEWTON, _HALVINGS = 30, 8  # at most, in one implicit step
_DONE = 1e-7  # a Newton step this short ends it
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
        self.recorder = Recorder(system, self.config, dt, levels)
        self._dt, self._every = dt, max(1, round(self.config.interval / dt))
        self._pace = self.config.pace * self._every * dt
        inverse = np.diag(1 / self.Gamma) if self.Gamma.ndim == 1 else np.linalg.inv(self.Gamma)
        self._stiffness = inverse / self.mu
        self._mirror_prior, self._metric_prior = self._mirror(self.prior)

    def init(self, first: Measurement) -> State:
        """As in the base class, with a memory of nothing."""
        state = super().init(first)
        return state._replace(memory=self.recorder.begin(first))

    def step(self, state: State, previous: Measurement, following: Measurement) -> State:
        """One RK4 step of (44, 45); then, if it is time, an implicit step of the memory."""
        moved = super().step(state, previous, following)
        if moved.status is not Status.completed or state.memory is None:
            return moved._replace(memory=state.memory, spent=state.spent)
        between = self._between(previous, following, following.t - previous.t)
        memory = self.recorder.add(state.memory, previous, between, following)
        theta, spent = moved.theta_hat, state.spent
        if memory.step % self._every == 0:
            blocks, memory = memory.blocks, self.recorder.doubt(memory)
            if memory.trusted is not None and memory.blocks < blocks:  # an actuator has changed
                theta = memory.trusted.theta
                spent += float(self.conserved(moved.theta_hat) - self.conserved(theta))
            elif not memory.alarmed:
                theta, memory = self.settle(theta, memory)
                spent += self._cost(moved.theta_hat, theta)
        return moved._replace(theta_hat=theta, memory=memory, spent=spent)

    def settle(self, theta: Array, memory: Memory) -> tuple[Array, Memory]:
        """(p,) θ⁺ after an implicit step from θ̂, and the memory with its view of what comes next.

        θ̂ itself where the memory says nothing yet.
        """
        remembered = quotient(memory, self.system.space)
        if remembered is None:
            return theta, memory
        pace, anchor, start = self._pace, self.anchor, theta
        mirror, _ = self._mirror(start)
        cost, _ = remembered.weighted(theta, memory)
        for _ in range(_NEWTON):
            slope, metric = self._mirror(theta)
            anchored = anchor * (slope - self._mirror_prior)
            gradient = pace * (cost.gradient(theta) + anchored) + slope - mirror
            hessian = pace * cost.curvature(theta) + (pace * anchor + 1) * metric
            way = -_solve(hessian, gradient)
            length = float(np.sqrt(way @ metric @ way))
            if not length > _DONE:  # NaN too: what was reached stands
                break
            theta, moved = self._descend(cost, start, theta, min(1.0, _REACH / length) * way)
            if not moved:
                break
        cost, view = remembered.weighted(theta, memory)
        trusted = Trusted(theta, cost.plant(theta, self.system.space.actuators))
        return theta, memory._replace(view=view, trusted=trusted)

    def _cost(self, before: Array, after: Array) -> float:
        """What an implicit step takes from the conserved quantity: 2 D_ψ(θ⁺‖θ̂), if unanchored."""
        if self.anchor:
            return float(self.conserved(before) - self.conserved(after))
        return 2 * float(self.divergence(after, before))

    def slack(self, state: State, theta: Array) -> float:
        """½ κ h R(θ) max_j θ_j/θ̂_j over the actuators, the most that a step can raise V by."""
        memory = state.memory
        remembered = None if memory is None else quotient(memory, self.system.space)
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
        if memory is None or memory.view is None or not memory.scored:
            return None
        cost = quotient(memory, self.system.space)
        assert cost is not None  # there was a view
        _, metric = self._mirror(theta)
        prior = max(self.anchor, _HINT) * metric
        cost, view = cost.weighted(theta, memory)
        bread = _inverse(cost.curvature(theta) + prior)
        data = cost.curvature(theta) if cost.seen is None else cost.seen
        bias = memory.blocks * memory.bias
        scatter = data + memory.blocks * memory.meat + np.outer(bias, bias)
        return Confidence(
            bread @ (scatter + prior) @ bread,
            _inverse(self._metric_prior),
            memory.blocks * (1 - view.rho) / (1 + view.rho),
        )

    def _descend(
        self, cost: Quotient, start: Array, theta: Array, way: Array
    ) -> tuple[Array, bool]:
        """The first of way, way/2, way/4 … that lowers what an implicit step makes least."""
        before = self._objective(cost, start, theta)
        for _ in range(_HALVINGS):
            ahead = theta + way
            if self._objective(cost, start, ahead) <= before + 1e-12 * abs(before):
                return ahead, True
            way = 0.5 * way
        return theta, False

    def _objective(self, cost: Quotient, start: Array, theta: Array) -> float:
        """κ h [R(θ) + w D_ψ(θ‖θ̂₀)/μ]/μ + D_ψ(θ‖θ̂)/μ."""
        pace = self._pace
        near = self.divergence(theta, start) + pace * self.anchor * self.divergence(
            theta, self.prior
        )
        return pace * cost.value(theta) + float(near) / self.mu

    def _mirror(self, theta: Array) -> tuple[Array, Array]:
        """(p,) ∇ψ(θ)/μ and (p, p) ∇²ψ(θ)/μ."""
        slope, metric = gradient_and_hessian(self.cone, theta)
        return self._stiffness @ theta + slope, self._stiffness + metric


def _solve(matrix: Array, right: Array) -> Array:
    """(p,) solves with a positive definite matrix whose entries differ by many orders of size."""
    scale = 1 / np.sqrt(np.diag(matrix))
    return np.linalg.solve(matrix * np.outer(scale, scale), right * scale) * scale


def _inverse(matrix: Array) -> Array:
    """(p, p) its inverse, where it is not singular to the last digit; 0 where it is."""
    scale = 1 / np.sqrt(np.diag(matrix))
    balanced = np.outer(scale, scale)
    return np.linalg.pinv(matrix * balanced, rcond=1e-14, hermitian=True) * balanced
