"""The estimate that a tracking controller computes its commands with."""

from __future__ import annotations

import numpy as np

from ...identifiers.metric import CHARTS, Metric, adapt, chart, enter, hold, leave, sound
from ...numerics.kernels import kernel
from ...numerics.linalg import copy_into
from ...parameters import Array


class Estimate:
    """θ̂ of a controller: adapted by θ̂̇ = −(∇²ψ(θ̂))⁻¹ Wᵀ s in a metric's chart, or not at all.

    The slope −Wᵀ s does not depend on θ̂. It is taken half-way between two samples and held in
    Heun's method, with an error of third order in the time between them.

    Args:
        prior: (p,) θ̂(0).
        metric: ∇²ψ; None if no motion changes θ̂.

    Attributes:
        theta: (p,) θ̂; what listens to an identifier overwrites it.
        metric: as given.
    """

    def __init__(self, prior: Array, metric: Metric | None = None):
        self.metric, self._prior = metric, np.array(prior, dtype=np.float64)
        if metric is not None:
            self._law = metric.law(np.zeros(1))
            self._work = workspace(self._law, len(self._prior))
        self.reset()

    def reset(self) -> None:
        """Returns to the prior."""
        self.theta = self._prior.copy()
        if self.metric is not None:
            self._eta = np.empty(len(self.theta))
            begin(self._law, self._work, self.theta, self._eta)

    def learn(self, slope: Array, step: float) -> None:
        """Integrates the adaptation over the time between two samples.

        θ̂ stays where it is if that leaves the metric's domain.

        Args:
            slope: (p,) −Wᵀ s half-way between them.
            step: time between them [s].
        """
        if self.metric is not None:
            theta = np.empty(len(self.theta))
            if descend(self._law, self._work, slope, step, self._eta, self.theta, theta):
                self.theta = theta


@kernel(None, *CHARTS)
def workspace(law, p):
    """Allocates the workspace of `descend`: rates at both ends, η and θ̂ after a first step."""
    return np.empty(p), np.empty(p), np.empty(p), np.empty(p), chart(law)


@kernel(None, *CHARTS)
def begin(law, work, theta, eta):
    """Writes the chart's η (p,) of θ̂ (p,)."""
    enter(law, theta, eta, work[4])


@kernel(None, *CHARTS)
def descend(law, work, slope, step, eta, theta, moved):
    """A step of Heun's method in the chart; returns whether θ̂ is still inside its domain.

    Args:
        law: the metric.
        work: of `workspace`.
        slope: (p,) −Wᵀ s.
        step: its length [s].
        eta: (p,) η of θ̂; moved, unless the step fails.
        theta: (p,) θ̂ at the start.
        moved: (p,) receives θ̂ at the end.
    """
    first, second, ahead, guess, scratch = work
    p = eta.shape[0]
    adapt(law, eta, theta, slope, first, scratch)
    for i in range(p):
        ahead[i] = eta[i] + step * first[i]
    hold(law, eta, ahead)
    leave(law, ahead, guess, scratch)
    adapt(law, ahead, guess, slope, second, scratch)
    for i in range(p):
        ahead[i] = eta[i] + 0.5 * step * (first[i] + second[i])
    hold(law, eta, ahead)
    leave(law, ahead, moved, scratch)
    if not sound(law, moved):
        return False
    copy_into(ahead, eta)
    return True
