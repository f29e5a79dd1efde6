"""Matrices that tests are built from, and how close two arrays are."""

from __future__ import annotations

from typing import Any

import numpy as np

from nsaid_mj.core.parameters import Array


def assert_near(one: Any, other: Any, tolerance: float = 1e-11, *, floor: float = 1e-300) -> None:
    """Two arrays differ by at most `tolerance` of the largest entry of both, or of `floor`."""
    size = max(np.abs(one).max(), np.abs(other).max(), floor)
    assert np.abs(np.asarray(one) - other).max() <= tolerance * size


def skew(a: Array) -> Array:
    """(3, 3) S(a) with S(a) b = a × b."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def coupled(diagonal: Array, rng: np.random.Generator) -> Array:
    """(p, p) positive definite matrix with off-diagonal entries of both signs.

    Its diagonal is of the size of `diagonal` (p,), and so are its off-diagonal entries.
    """
    p = len(diagonal)
    A = 0.3 * rng.standard_normal((p, p)) / np.sqrt(p)
    root = np.sqrt(diagonal)
    gain = np.outer(root, root) * (np.eye(p) + A @ A.T)
    return 0.5 * (gain + gain.T)
