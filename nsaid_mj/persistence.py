"""Persistence of excitation: (2) for all parameters, (75) orthogonally to P(θ).

(2) and (75) bound ‖∫ B w dτ‖ over a window from below for every unit w. Read literally, the
integral is a vector of n numbers, linear in w: as soon as w has more dimensions than n there is a
w for which it is 0, and neither condition can hold. The levels here are those of the Gramian,

    ε₀ = min over ‖w‖ = 1 of (δ₀ ∫ ‖B w‖² dτ)^½ = (δ₀ λ_min(∫ BᵀB dτ))^½,

which by Cauchy–Schwarz bounds the literal norm over the window and every part of it from above,
has the same unit, is positive exactly where no direction stays unexcited throughout the window,
and is what the proof of Theorem 2 needs (some t_j in the window with ‖B w‖ > 0).
B is taken in θ/scale coordinates.
"""

from __future__ import annotations

import numpy as np

from .errors import InvalidInput
from .parameters import Array


def level(window: Array, dt: float, basis: Array | None = None) -> float:
    """ε₀ of one window.

    Args:
        window: (k, n, p) samples of the regressor times diag(scale) [N·m], dt apart.
        dt: time between them [s].
        basis: (p, d) orthonormal basis of the subspace that w is restricted to (P̄_⊥ for (75));
            None is all of it (2).

    Returns:
        ε₀ [N·m·s], by singular values of the stack: 0 is told from 1e-15 of the largest.
    """
    k, n, p = window.shape
    B = window.reshape(k * n, p)
    B = B if basis is None else B @ basis
    if B.shape[0] < B.shape[1] or B.shape[1] == 0:
        return 0.0 if B.shape[1] else np.inf
    smallest = np.linalg.svd(B, compute_uv=False)[-1]
    return float(np.sqrt(k * dt) * np.sqrt(dt) * smallest)


class PersistenceMonitor:
    """Levels of (2) and (75) as the run goes on, from the identifier's own regressor.

    The identifier knows no P(θ). By Courant and Fischer the (r+1)-th smallest eigenvalue of the
    window's Gramian bounds the level on any subspace of dimension p − r from above, so that is
    what it shows for (75); the summary has the exact one, after the fact.

    Args:
        p: number of parameters.
        r: dim P_s, from the structure under the prior.
        window: δ₀ [s].

    Raises:
        InvalidInput: the window is not positive.
    """

    def __init__(self, p: int, r: int, window: float):
        if not (np.isfinite(window) and window > 0):
            raise InvalidInput("pe_window", "a time > 0 s", window, "One period of excitation.")
        self._samples, self._time, self._window, self._r = [], 0.0, window, min(r, p - 1)
        self.level, self.level_perp = 0.0, 0.0

    def add(self, W_s: Array, dt: float) -> None:
        """Adds a sample W·diag(scale) (n, p) that stands for dt seconds."""
        self._samples.append(np.sqrt(dt) * W_s)
        self._time += dt
        if self._time >= self._window * (1 - 1e-9):
            B = np.concatenate(self._samples)
            eigenvalues = np.maximum(np.linalg.eigvalsh(B.T @ B), 0.0)
            self.level = float(np.sqrt(self._time * eigenvalues[0]))
            self.level_perp = float(np.sqrt(self._time * eigenvalues[self._r]))
            self._samples, self._time = [], 0.0
