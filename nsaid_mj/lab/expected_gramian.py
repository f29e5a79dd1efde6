"""Simulates the excitation under the prior, to predict the Gramian for the gain design.

No true value is used. The prediction is accurate enough: an error of 30 % in θ changes the
Gramian's eigenvalues by about as much.
"""

import numpy as np

from ..base import InvalidInput
from ..core import Array, Measurement, SecondOrderSystem
from .control.driver import Driver

_SAMPLES = 3000  # largest number averaged in the Gramian


def expected_gramian(
    system: SecondOrderSystem, driver: Driver, theta: Array, dt: float, duration: float
) -> Array:
    """(p, p) mean of S Wᵀ M⁻¹ W S, S = diag(scale), over a motion simulated under θ (p,).

    In θ/scale, this is the Hessian of the cost that (45) descends when Δv follows θ̂. Times are in
    seconds.

    Raises:
        InvalidInput: under θ the mass matrix becomes indefinite, or the motion diverges.
    """
    numbers, v = driver.start()
    q = system.position(np.asarray(numbers, dtype=np.float64))
    v = np.asarray(v, dtype=np.float64)
    scale = system.space.scale
    steps = max(1, round(duration / dt))
    stride = -(-steps // _SAMPLES)
    gramian = np.zeros((system.p, system.p))
    count = 0
    for k in range(steps):
        t = k * dt
        u = np.asarray(driver.command(t, q, v), dtype=np.float64)
        a, W, pivot = system.evaluate_at(t, q, v, u, v, theta)
        if not (pivot > 0 and np.isfinite(a).all()):
            raise InvalidInput(
                "gamma",
                "a prior under which the motion can be simulated",
                f"one under which the simulation fails at {t:g} s",
                "Use --gamma scale, a smaller initial_error, or a gentler excitation.",
            )
        if k % stride == 0:
            M = system.mass_matrix(np.concatenate([q, v]), theta)
            L = np.linalg.cholesky(M)
            rows = np.linalg.solve(L, W * scale)
            gramian += rows.T @ rows
            count += 1
        q, v = _step(system, Measurement(t, q, v, u), a, theta, dt)
    return gramian / count


def _step(
    system: SecondOrderSystem, sample: Measurement, a: Array, theta: Array, dt: float
) -> tuple[Array, Array]:
    """One RK4 step with the command held; the stages' tangent steps are summed in one tangent."""
    t, q, v, u = sample
    speeds = [v]
    rates = [a]
    for reach in (dt / 2, dt / 2, dt):
        speeds.append(v + reach * rates[-1])
        at = system.integrate(q, reach * speeds[-2])
        rates.append(system.evaluate_at(t, at, speeds[-1], u, speeds[-1], theta).a)
    way, change = (
        dt / 6 * (one + 2 * two + 2 * three + four) for one, two, three, four in (speeds, rates)
    )
    return system.integrate(q, way), v + change
