"""How θ̂ and its covariance move: inside the cone, and with the error of the common scale."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..cone.barrier import inside, local_norm

_REACH = 0.5  # longest update of θ̂ in the cone's metric: half of a Dikin ellipsoid
_HALVINGS = 30  # of an update that rounding takes out of the cone


@njit(cache=True)
def move_inside(cone, theta, step, trial):
    """Moves θ̂ (p,) by a share of a step (p,), inside half of a Dikin ellipsoid of the cone.

    Inside that ellipsoid is inside the cone, but for rounding next to the boundary: there the share
    is halved until θ̂ and its metric are sound, and is 0 if they never are. `trial` (p,) is
    workspace.

    Returns:
        The share, at most 1.
    """
    length = local_norm(cone, theta, step)
    if not length < np.inf:
        return 0.0
    share = min(1.0, _REACH / length) if length > 0.0 else 1.0
    for _ in range(_HALVINGS):
        for k in range(theta.shape[0]):
            trial[k] = theta[k] + share * step[k]
        if inside(cone, trial) and local_norm(cone, trial, step) < np.inf:
            for k in range(theta.shape[0]):
                theta[k] = trial[k]
            return share
        share *= 0.5
    return 0.0


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
