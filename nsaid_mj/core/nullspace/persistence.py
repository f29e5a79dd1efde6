"""Persistence of excitation: (2) for all parameters, (75) orthogonally to P(θ).

(2) and (75) bound ‖∫ B w dτ‖ over a window from below for every unit w. Read literally, the
integral is a vector of n numbers, linear in w: if w has more than n dimensions, the integral is 0
for some w, and neither condition can hold. The levels here are those of the Gramian,

    ε₀ = min over ‖w‖ = 1 of (δ₀ ∫ ‖B w‖² dτ)^½ = (δ₀ λ_min(∫ BᵀB dτ))^½.

By Cauchy–Schwarz they bound the literal norm over the window and any part of it from above. They
have the same unit, are positive if and only if every direction is excited somewhere in the window,
and are what the proof of Theorem 2 needs (some t_j in the window with ‖B w‖ > 0).
B is taken in θ/scale coordinates.
"""

import numpy as np

from ...base import InvalidInput
from ..parameters import Array


class PersistenceMonitor:
    """Levels of (2) and (75) during a run, from the identifier's own regressor.

    As P(θ) is unknown during a run, the level of (75) is replaced by an upper bound: by Courant and
    Fischer, the (r+1)-th smallest eigenvalue of the window's Gramian bounds the level on any
    subspace of dimension p − r. The summary has the exact level.

    Args:
        p: number of parameters.
        r: dim P_s, from the structure under the prior.
        window: δ₀ [s].

    Attributes:
        level: ε₀ of (2) in the last complete window [N·m·s].
        level_perp: upper bound of ε₀ of (75) in the last complete window [N·m·s].

    Raises:
        InvalidInput: the window is not positive.
    """

    @staticmethod
    def level_of(window: Array, dt: float, basis: Array | None = None) -> float:
        """ε₀ of one window.

        Args:
            window: (k, n, p) samples of the regressor times diag(scale) [N·m].
            dt: time between samples [s].
            basis: (p, d) orthonormal basis of the subspace to which w is restricted (P̄_⊥ for (75));
                None is the whole space (2).

        Returns:
            ε₀ [N·m·s], from the stack's singular values, so that it resolves 1e-15 of the largest.
        """
        k, n, p = window.shape
        B = window.reshape(k * n, p)
        B = B if basis is None else B @ basis
        if B.shape[0] < B.shape[1] or B.shape[1] == 0:
            return 0.0 if B.shape[1] else np.inf
        smallest = np.linalg.svd(B, compute_uv=False)[-1]
        return float(np.sqrt(k * dt) * np.sqrt(dt) * smallest)

    def __init__(self, p: int, r: int, window: float):
        if not (np.isfinite(window) and window > 0):
            raise InvalidInput("pe_window", "a time > 0 s", window, "One period of excitation.")
        self._samples, self._time, self._window, self._r = [], 0.0, window, min(r, p - 1)
        self.level = 0.0
        self.level_perp = 0.0

    def add(self, W_s: Array, dt: float) -> None:
        """Adds a sample W·diag(scale) (n, p) that represents dt seconds."""
        self._samples.append(np.sqrt(dt) * W_s)
        self._time += dt
        if self._time >= self._window * (1 - 1e-9):
            B = np.concatenate(self._samples)
            eigenvalues = np.maximum(np.linalg.eigvalsh(B.T @ B), 0.0)
            self.level = float(np.sqrt(self._time * eigenvalues[0]))
            self.level_perp = float(np.sqrt(self._time * eigenvalues[self._r]))
            self._samples = []
            self._time = 0.0
