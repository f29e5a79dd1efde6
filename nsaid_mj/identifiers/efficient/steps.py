"""How θ̂ and its covariance move: long steps are damped, and the scale's error is carried along.

A step that is too long for the cone of physical parameters is damped as Levenberg and Marquardt do,
in the metric ∇²b: with P⁺ the covariance after an undamped update by the gain K, the gain is

    K' = G K,    G = (1 + κ P⁺ ∇²b)⁻¹,    P_θθ ← P − G M − M Gᵀ + G M Gᵀ,    M = K S Kᵀ.

Directions that the data determine take their full step; those in which P⁺ reaches out of the cone
wait. P is that of the gain applied (Joseph's form): what is not learned stays unknown.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..cone.barrier import gradient_and_hessian, inside, local_norm

_REACH = 0.5  # longest update of θ̂ in the cone's metric: half of a Dikin ellipsoid
_FIRST, _TIMES = 1e-6, 10.0  # least κ that is tried, and the factor from one to the next
_MOST = 12  # values of κ, and halvings of a step that rounding takes out of the cone


@njit(cache=True)
def step_inside(cone, scale, theta, Ptt, gained, whitened, e, V, step, kappa):
    """Moves θ̂ (p,) by a Kalman step, damped until it is inside half of a Dikin ellipsoid.

    Args:
        cone: of physical parameters.
        scale: (p,) of θ.
        theta: (p,) θ̂; overwritten. It does not move where rounding leaves no step inside.
        Ptt: (p, p) P_θθ before the update.
        gained: (p, p) M.
        whitened: (2n, p) L⁻¹ P_xθ, so that K L = whitenedᵀ.
        e: (2n,) normalised innovation.
        V: (p, 2n) K' L; written.
        step: (p,) the step in units of θ; written.
        kappa: κ of the last damped step, which the next one begins with; 0 before the first.

    Returns:
        κ of this step; 0 if V = K L.
    """
    p = V.shape[0]
    V[:] = whitened.T
    _write_step(V, e, scale, step)
    length = local_norm(cone, theta, step)
    if length <= _REACH and _moved(cone, theta, step):
        return 0.0
    kappa = max(_FIRST, kappa / _TIMES)
    if length < np.inf:
        units = np.outer(scale, scale)
        reached = np.dot(Ptt - gained, gradient_and_hessian(cone, theta)[1] * units)
        for _ in range(_MOST):
            damping = kappa * reached
            for i in range(p):
                damping[i, i] += 1.0
            V[:] = np.linalg.solve(damping, whitened.T.copy())
            _write_step(V, e, scale, step)
            if local_norm(cone, theta, step) <= _REACH:
                break
            kappa *= _TIMES
        share = 1.0
        for _ in range(_MOST):
            if local_norm(cone, theta, step) <= _REACH and _moved(cone, theta, step):
                V *= share
                return kappa
            share *= 0.5
            step *= 0.5
    V[:] = 0.0
    return kappa


@njit(cache=True)
def _write_step(V, e, scale, step):
    """Writes the step scale · V e (p,)."""
    for i in range(V.shape[0]):
        step[i] = 0.0
        for k in range(V.shape[1]):
            step[i] += V[i, k] * e[k]
        step[i] *= scale[i]


@njit(cache=True)
def _moved(cone, theta, step):
    """Moves θ̂ (p,) by a step (p,) if it and its metric there are sound; whether they are."""
    ahead = theta + step
    if not (inside(cone, ahead) and local_norm(cone, ahead, step) < np.inf):
        return False
    theta[:] = ahead
    return True


@njit(cache=True)
def carry_scale(before, after, scale, Pxt, Ptt, moved, gained):
    """Carries the error of the common scale along with θ̂, from `before` (p,) to `after` (p,).

    No motion tells the common scale: B θ̂ = 0 at the θ̂ at which the step is linearised. Linearised
    elsewhere in the next step, the covariance would take the difference for information (Huang,
    Mourikis, Roumeliotis, IJRR 29(5), 2010). So an error s of the scale, θ = (1 + s)(θ̂ + …), stays
    one: P ← T P Tᵀ with T = 1 + d wᵀ, d = after − before, w ∝ before, wᵀ before = 1 (in units of
    the scale), which maps `before` to `after` and keeps θ̂ᵀ P⁻¹ θ̂.

    Args:
        before: (p,) θ̂ before the step.
        after: (p,) after it.
        scale: (p,) of θ.
        Pxt: (2n, p) covariance of the state with θ/scale; overwritten.
        Ptt: (p, p) that of θ/scale; overwritten.
        moved: (p,) workspace.
        gained: (p,) workspace.
    """
    p, norm = before.shape[0], 0.0
    for k in range(p):
        moved[k] = (after[k] - before[k]) / scale[k]
        norm += (before[k] / scale[k]) ** 2
    along = 0.0
    for i in range(p):
        gained[i] = 0.0
        for k in range(p):
            gained[i] += Ptt[i, k] * before[k] / (scale[k] * norm)
        along += before[i] / (scale[i] * norm) * gained[i]
    for i in range(p):
        for k in range(i + 1):
            change = moved[i] * gained[k] + gained[i] * moved[k] + along * moved[i] * moved[k]
            Ptt[i, k] += change
            Ptt[k, i] = Ptt[i, k]
    for j in range(Pxt.shape[0]):
        own = 0.0
        for k in range(p):
            own += Pxt[j, k] * before[k] / (scale[k] * norm)
        for k in range(p):
            Pxt[j, k] += own * moved[k]
