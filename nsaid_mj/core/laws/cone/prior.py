"""The prior: random parameters about given ones, inside the cone, and their spread."""

import numpy as np

from ....base import InvalidInput
from ...parameters import Array, ParameterSpace
from ...quotient.cone import Cone, block_matrix, coordinates, read_block, tied

_FLOOR = 0.01  # least positive number or diagonal entry of a matrix to draw about, over its scale
_LEAST = 1e-6  # relative error of a prior; second moments of less are lost in rounding errors
_MOST = 10.0  # relative error of a prior; second moments of much more overflow
_EDGE = 1e-3  # least eigenvalue of a matrix of unit diagonal to draw about
_FREE = 0.1  # least size of a free parameter, over its scale


class Prior:
    """Parameters that are known up to about ±error, inside the cone of physical ones.

    Args:
        space: the parameters.
        theta: (p,) their values. On the cone's boundary they are first moved inside.
        error: relative error.
    """

    def __init__(self, space: ParameterSpace, theta: Array, error: float):
        self.space = space
        self.theta = theta
        self.error = error

    def draw(self, rng: np.random.Generator) -> Array:
        """(p,) random parameters that differ by about ±error, inside the cone for any error.

        Positive numbers are multiplied by e^u, with u in ±error; a matrix P becomes A P Aᵀ after
        scaling to unit diagonal, with e^{±error/2} on A's diagonal and ±error/4 off it; free blocks
        change by ±error of their size. In a tied matrix, diagonal parameters are drawn as positive
        numbers and the others as free ones; the latter are then reduced until the smallest
        eigenvalue of the scaled matrix is at least e^{−error} of its former value.
        """
        space = self.space
        theta = self.theta
        error = self.error
        cone = Cone.of(space)
        drawn = np.array(theta, dtype=np.float64)
        pairing = coordinates(cone)
        for block, place in space:
            if block.geometry == "free":
                size = np.maximum(np.abs(theta[place]), _FREE * block.scale)
                drawn[place] += error * size * rng.uniform(-1, 1, len(block))
            elif block.geometry == "positive":
                start = np.maximum(theta[place], _FLOOR * block.scale)
                drawn[place] = start * np.exp(error * rng.uniform(-1, 1, len(block)))
        for i, (_, _, k, _, _) in enumerate(cone.blocks):
            if tied.py_func(cone, i):
                _draw_tied(cone, i, space.scale, error, rng, drawn)
                continue
            N, balance = _scaled(cone, i, theta, space.scale)
            A = error / 4 * rng.uniform(-1, 1, (k, k))
            A[np.diag_indices(k)] = np.exp(error / 2 * rng.uniform(-1, 1, k))
            read_block(cone, i, A @ N @ A.T / np.outer(balance, balance), pairing, drawn)
        return drawn

    def covariance(self) -> Array:
        """(p, p) second moments of the draws about θ, of θ/scale: where the truth may be.

        They are those of a truth that is drawn about θ and, up to terms of higher order in the
        error, of a truth about which θ was drawn. They neglect the common mean of positive numbers,
        as e^{±error} is 1 + error²/6 on average, and the reduction of tied matrices. A positive
        number that may have been moved inside may have any smaller value as well. An error below
        1e-6 or above 10 counts as that.

        Raises:
            InvalidInput: the error is not > 0, or θ not finite.
        """
        space = self.space
        error = self.error
        theta = space.check(self.theta)
        if not (np.isfinite(error) and error > 0):
            raise InvalidInput(
                "error", "a relative error > 0", error, "Give the spread of the prior."
            )
        error = min(max(error, _LEAST), _MOST)
        cone = Cone.of(space)
        pairing = coordinates(Cone.of(space))
        found = np.zeros((len(space),) * 2)
        for block, place in space:
            if block.geometry == "free":
                size = np.maximum(np.abs(theta[place]), _FREE * block.scale)
                found[place, place] = np.diag((error * size) ** 2 / 3)
            elif block.geometry == "positive":
                found[place, place] = np.diag(spread_of_numbers(theta[place], block.scale, error))
        for i, (start, end, *_) in enumerate(cone.blocks):
            found[start:end, start:end] = (
                _spread_of_tied(cone, i, theta, space.scale, error)
                if tied.py_func(cone, i)
                else _spread_of_matrix(cone, i, theta, space.scale, error, pairing)
            )
        return found / np.outer(space.scale, space.scale)


def _draw_tied(
    cone: Cone, block: int, scale: Array, error: float, rng: np.random.Generator, theta: Array
) -> None:
    """Overwrites a tied block of θ (p,) with a random draw; see `Prior.draw`."""
    start, end, _, first, last = cone.blocks[block]
    row, column, at = cone.entries[first:last].T
    on = np.unique(at[row == column])
    off = np.unique(at[row != column])
    theta[on] = np.maximum(theta[on], _FLOOR * scale[on])
    kept = np.exp(-error) * max(_EDGE, _smallest(cone, block, theta))
    u = error * rng.uniform(-1, 1, end - start)
    theta[off] += np.maximum(np.abs(theta[off]), _FREE * scale[off]) * u[off - start]
    theta[on] *= np.exp(u[on - start])
    gap = 1 - _smallest(cone, block, theta)  # proportional to the off-diagonal parameters
    if gap > 1 - kept:
        theta[off] *= (1 - kept) / gap


def _smallest(cone: Cone, block: int, theta: Array) -> float:
    """Smallest eigenvalue of a block's P after scaling it to unit diagonal."""
    P = block_matrix(cone, block, theta)
    balance = 1 / np.sqrt(P.diagonal())
    return float(np.linalg.eigvalsh(P * np.outer(balance, balance))[0])


def spread_of_numbers(theta: Array, scale: Array, error: float) -> Array:
    """(k,) second moments of positive numbers (k,) about θ: E (e^u − 1)² = E e^2u − 2 E e^u + 1."""
    start = np.maximum(theta, _FLOOR * scale)
    floor = _FLOOR * scale
    moments = start**2 * (np.sinh(2 * error) / (2 * error) - 2 * np.sinh(error) / error + 1)
    moved = theta <= floor * np.exp(error)
    return np.where(moved, np.maximum(moments, floor**2), moments)


def _scaled(cone: Cone, block: int, theta: Array, scale: Array) -> tuple[Array, Array]:
    """A block's P, (k, k), scaled to unit diagonal and moved inside, and the factors (k,)."""
    P = block_matrix(cone, block, theta)
    P += np.tril(P, -1).T
    smallest = _FLOOR * np.abs(block_matrix(cone, block, scale).diagonal())
    balance = 1 / np.sqrt(np.maximum(P.diagonal(), smallest))
    N = P * np.outer(balance, balance)
    N += max(0.0, _EDGE - np.linalg.eigvalsh(N)[0]) * np.eye(len(N))
    return N, balance


def _spread_of_matrix(
    cone: Cone, block: int, theta: Array, scale: Array, error: float, pairing: Array
) -> Array:
    """(c, c) second moments of the draws A N Aᵀ of a block's matrix about N.

    With A = a·1 + E, the entries of E independent with means 0 and variances V, the draws deviate
    by (a² − 1) N + a (E N + N Eᵀ) + E N Eᵀ. The last term is uncorrelated with the others; so are
    its entries, with means δ_ij Σ_k N_kk V_ik and variances Σ_kl N_kl² V_ik V_jl, i ≠ j.
    """
    N, balance = _scaled(cone, block, theta, scale)
    k = len(N)
    half = error / 2
    V = np.full((k, k), (error / 4) ** 2 / 3)
    a = np.sinh(half) / half
    V[np.diag_indices(k)] = np.sinh(error) / error - a**2
    J = np.zeros((k, k, k, k))  # derivatives of the draw's ij by E_kl
    one = np.eye(k)
    J += a * (np.einsum("ik,lj->ijkl", one, N) + np.einsum("jk,li->ijkl", one, N))
    mean = (a**2 - 1) * N + np.diag(V @ N.diagonal())
    last = V @ N**2 @ V.T
    fourth = V**2 @ (N.diagonal() ** 2)  # E E_kk⁴ − V² is 4/5 V² instead of 2 V²
    last[np.diag_indices(k)] += last.diagonal() - 1.2 * fourth
    at = np.tril_indices(k)
    J = J[at].reshape(len(at[0]), -1)
    moments = (J * V.ravel()) @ J.T + np.outer(mean[at], mean[at]) + np.diag(last[at])
    start, end, _, first, last_entry = cone.blocks[block]
    to_theta = np.zeros((end - start, k, k))
    i, j, index = cone.entries[first:last_entry].T
    to_theta[index - start, i, j] = pairing[first:last_entry] / (balance[i] * balance[j])
    to_theta = to_theta[:, *at]
    return to_theta @ moments @ to_theta.T


def _spread_of_tied(cone: Cone, block: int, theta: Array, scale: Array, error: float) -> Array:
    """(c, c) second moments of the draws of a tied block about θ, before they are reduced."""
    start, end, _, first, last = cone.blocks[block]
    row, column, at = cone.entries[first:last].T
    own = theta[start:end]
    scale = scale[start:end]
    size = np.maximum(np.abs(own), _FREE * scale)
    moments = (error * size) ** 2 / 3
    on = np.unique(at[row == column]) - start
    moments[on] = spread_of_numbers(own[on], scale[on], error)
    return np.diag(moments)
