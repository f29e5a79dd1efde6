"""The Cramér–Rao bound by least squares of a whole log, without a filter."""

import numpy as np
import scipy.linalg

from nsaid_mj.core.log import Log
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.core.structure.touching import Touch
from nsaid_mj.core.structure.transition import step

_BLOCK = 100  # samples whose rows enter together


def batch_bound(system: SecondOrderSystem, theta: Array, R: Array, G: Array, log: Log) -> Array:
    """(d, d) upper triangular A with P_zz = (Aᵀ A)⁻¹, where θ/scale = G z + const, z ~ N(0, 1).

    The unknowns are the state at the first sample and z: the rows are R^−½ times the derivatives of
    all measurements by them. These grow along a motion that is unstable, so that only short logs
    keep their precision. R (2n,) are variances of the noise, G is (p, d).
    """
    n, m, p, size, d = system.n, system.m, system.p, 2 * system.n, G.shape[1]
    scale, memory, end = np.array(system.space.scale), system.structure.memory(), np.empty(n)
    F, B, weight = np.empty((size, 3 * n)), np.empty((n, p)), 1 / np.sqrt(R)[:, None]
    H = np.eye(size, size + d)
    A = np.asarray(scipy.linalg.block_diag(weight * np.eye(size), np.eye(d)))
    rows: list[Array] = []
    for k in range(1, len(log.t)):
        start = log.q[k - 1], log.v[k - 1], log.u[k - 1], log.t[k] - log.t[k - 1], theta, scale
        spare = np.empty(m), np.empty(m), end
        assert (
            step(system.forward, *start, *memory, *spare, F, B, np.zeros((0, n)), Touch.of(0, n))
            > 0
        )
        H = F[:, :size] @ H
        H[:, size:] += F[:, size:] @ (B @ G)
        rows.append(weight * H)
        if len(rows) == _BLOCK or k == len(log.t) - 1:
            A = np.asarray(np.linalg.qr(np.vstack([A, *rows]), mode="r"))
            rows.clear()
    return A[size:, size:]
