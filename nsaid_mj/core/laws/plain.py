"""A law of the user's own, in plain numpy: the rates of v̂ and θ̂, and nothing else."""

from abc import abstractmethod

import numpy as np

from ...base import InvalidInput
from ..log import Log, Measurement
from ..parameters import Array
from ..structure.system import SecondOrderSystem, checked
from .base import Confidence, Estimates, Identifier, State, Status
from .nullspace_aid import end_of


class NumpyIdentifier(Identifier):
    """An identifier from the rates of its state, integrated by RK4, the command held.

    A subclass defines `rates`. It states no confidence and conserves nothing; V (66) is not judged
    along its runs. A step takes four evaluations of the rates in Python, about .1 ms for an arm.

    Args:
        system: the structure.
        prior: (p,) θ̂(0).
        hermite: cubic Hermite interpolation of the measured state between samples; else linear.

    Raises:
        InvalidInput: the prior has not the structure's shape, or is not finite.
    """

    conserves = False

    def __init__(self, system: SecondOrderSystem, prior: Array, hermite: bool = True):
        self.system = system
        self.hermite = hermite
        self.prior = system.space.check(prior, "prior")

    @abstractmethod
    def rates(self, sample: Measurement, v_hat: Array, theta_hat: Array) -> tuple[Array, Array]:
        """v̂̇ (n,) and θ̂̇ (p,) at a sample, for v̂ (n,) and θ̂ (p,); a pure function of these."""

    def init(self, first: Measurement) -> State:
        """The state with v̂ = v, so that Δv(t₀) = 0 as (46) assumes, and θ̂ = prior.

        Raises:
            InvalidInput: the measurement has a wrong shape or is not finite.
        """
        first = checked(self.system, first)
        return State(first.t, first.v.copy(), self.prior.copy(), np.inf, Status.completed)

    def resume(self, state: State, here: Measurement) -> State:
        """The state at a measurement after a gap, with v̂ = v."""
        here = checked(self.system, here)
        return state._replace(t=here.t, v_hat=here.v.copy())

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """RK4 steps along a log, up to the first after which M̂ is not positive definite.

        Raises:
            InvalidInput: the log's widths are not the system's, or `rates` returned other shapes.
        """
        self.check(log)
        start = Estimates.of(state)
        if state.status is not Status.completed:
            return state, start
        estimates = Estimates(*(np.repeat(part, len(log.t), axis=0) for part in start))
        middle = self.system.midpoints(log, self.hermite)
        for k in range(1, len(log.t)):
            before = log.at(k - 1)
            after = log.at(k)
            half = Measurement(
                0.5 * (before.t + after.t), middle.q[k - 1], middle.v[k - 1], before.u
            )
            after = after._replace(u=before.u)  # held
            v_hat = estimates.v_hat[k - 1]
            theta_hat = estimates.theta_hat[k - 1]
            z = self._stepped(np.concatenate([v_hat, theta_hat]), before, half, after)
            v_hat = z[: self.system.n]
            theta_hat = z[self.system.n :]
            estimates.v_hat[k] = v_hat
            estimates.theta_hat[k] = theta_hat
            finite = bool(np.isfinite(z).all())
            stage = self.system.evaluate_at(*after, v_hat, theta_hat) if finite else None
            estimates.pivot[k] = np.nan if stage is None else stage.pivot
            if not estimates.pivot[k] > 0:
                return end_of(state, log, estimates, k)
        return end_of(state, log, estimates, len(log.t))

    def _stepped(
        self, z: Array, before: Measurement, half: Measurement, after: Measurement
    ) -> Array:
        """(n+p,) v̂ and θ̂ after a step of RK4."""
        dt = after.t - before.t
        k1 = self._slope(before, z)
        k2 = self._slope(half, z + 0.5 * dt * k1)
        k3 = self._slope(half, z + 0.5 * dt * k2)
        k4 = self._slope(after, z + dt * k3)
        return z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def _slope(self, sample: Measurement, z: Array) -> Array:
        """(n+p,) the rates at v̂ and θ̂, checked for their shapes."""
        n = self.system.n
        p = self.system.p
        rates = self.rates(sample, z[:n], z[n:])
        if [np.shape(rate) for rate in rates] != [(n,), (p,)]:
            raise InvalidInput(
                "rates",
                f"arrays of shapes ({n},) and ({p},)",
                " and ".join(str(np.shape(rate)) for rate in rates),
                "Return the rates of v̂ and of θ̂.",
            )
        return np.concatenate([np.asarray(rate, dtype=np.float64) for rate in rates])

    def confidence(self, state: State) -> Confidence | None:
        """None: such a law states none."""
        return None
