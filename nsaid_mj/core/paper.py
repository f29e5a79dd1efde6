"""The paper's equations in plain numpy, each beside its number: slow, short, and the reference.

Compiled kernels are tested against this file (`tests/paper/test_reference.py`), and a user's own
law can be written from it (docs/your_law.md). Nothing is checked here, and nothing depends on how
a robot is stored: `Regressors` is all that a robot is, and a `SecondOrderSystem` is one.

Symbols: q (m,) position, v (n,) velocity, x = (q, v) (m+n,) as measured, u the command, w (n,) the
velocity that C multiplies, a (n,) acceleration, θ (p,) parameters. Where the paper writes a
function of t, the command is part of it; here u is written out.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from .parameters import Array


class Regressors(Protocol):
    """A robot: the regressors of (4), without any value of θ."""

    n: int  # number of velocities

    def W_M(self, x: Array, a: Array) -> Array:
        """(n, p) of (8), W_M θ = M(x, θ) a."""
        ...

    def W_C(self, x: Array, w: Array) -> Array:
        """(n, p) of (9), W_C θ = C(x, θ) w, with Ṁ − 2C skew."""
        ...

    def F(self, t: float, x: Array, u: Array) -> Array:
        """(n, p) of (4), F θ the sum of all forces."""
        ...


class Moment(NamedTuple):
    """A measurement of the robot."""

    t: float  # time [s]
    x: Array  # (m+n,) position and velocity
    u: Array  # (n_u,) command

    def v(self, n: int) -> Array:
        """(n,) the measured velocity."""
        return self.x[-n:]


# -- II: systems with nullspace parameter structure ------------------------------------------------


def mass_matrix(robot: Regressors, x: Array, theta: Array) -> Array:
    """(n, n) M(x, θ)."""
    return np.stack([robot.W_M(x, e) @ theta for e in np.eye(robot.n)], axis=1)  # (8)


def coriolis_matrix(robot: Regressors, x: Array, theta: Array) -> Array:
    """(n, n) C(x, θ)."""
    return np.stack([robot.W_C(x, e) @ theta for e in np.eye(robot.n)], axis=1)  # (9)


def residual(robot: Regressors, at: Moment, a: Array, theta: Array) -> Array:
    """(n,) M(x, θ) v̇ + C(x, θ) v − F(t, x) θ, which is 0 for the true θ."""
    M = mass_matrix(robot, at.x, theta)
    C = coriolis_matrix(robot, at.x, theta)
    return M @ a + C @ at.v(robot.n) - robot.F(at.t, at.x, at.u) @ theta  # (4)


def forces(
    v: Array, tau: Array, D: Array | float = 0.0, g: Array | float = 0.0, h: Array | float = 0.0
) -> Array:
    """(n,) what F(t, x) θ is: actuation τ less drag D(v) v, weight g and the ground's forces h.

    An arm has g alone (5), a marine or aerial vehicle D and g (6), a ground vehicle D and h (7).
    D is (n, n); the others are (n,). Dissipation of joints counts as D, too.
    """
    drag = D @ v if np.ndim(D) else D * v
    return -drag - g - h + tau  # (5), (6), (7)


def regressor(robot: Regressors, at: Moment, w: Array, a: Array) -> Array:
    """(n, p) the combined regressor W(t, x, w, a)."""
    return robot.W_M(at.x, a) + robot.W_C(at.x, w) - robot.F(at.t, at.x, at.u)  # (10)


def acceleration(robot: Regressors, at: Moment, w: Array, theta: Array) -> Array:
    """(n,) v̇(t, x, w, θ)."""
    force = (-robot.W_C(at.x, w) + robot.F(at.t, at.x, at.u)) @ theta
    found = np.linalg.solve(mass_matrix(robot, at.x, theta), force)  # (29)
    return np.asarray(found, dtype=np.float64)


def regressor_under(robot: Regressors, at: Moment, w: Array, theta: Array) -> Array:
    """(n, p) W(t, x, w, θ): the regressor at the acceleration that θ implies."""
    return regressor(robot, at, w, acceleration(robot, at, w, theta))  # (31)


class Bases(NamedTuple):
    """Orthonormal bases of P_s(θ) and of its complement."""

    P: Array  # (p, r) P̄ (33)
    P_perp: Array  # (p, p−r) P̄_⊥ (35)


def persistent_nullspace(W: Array, tolerance: float = 1e-8) -> Bases:
    """P_s(θ), the vectors that every regressor of a stack W (k, n, p) maps to 0, P(θ) and 0.

    W are regressors W(t, x, v, θ) along all feasible motions (15): at random states. Singular
    values below `tolerance` of the largest count as 0, so θ should be in units of its scale, and
    the rows of similar length.
    """
    rows = W.reshape(-1, W.shape[-1])
    singular, vectors = np.linalg.svd(rows)[1:]
    rank = int(np.count_nonzero(singular > tolerance * singular[0]))
    return Bases(vectors[rank:].T, vectors[:rank].T)  # W P̄ = 0 (34)


# -- III: nullspace adaptive identification --------------------------------------------------------


class Rates(NamedTuple):
    """Time derivatives of an identifier's state."""

    v_hat: Array  # (n,)
    theta_hat: Array  # (p,)


def rates(
    robot: Regressors, K: Array, Gamma: Array, at: Moment, v_hat: Array, theta_hat: Array
) -> Rates:
    """The update laws, with gains K (n, n) [1/s] and Γ (p, p), both positive definite."""
    dv = v_hat - at.v(robot.n)  # (37)
    a_hat = acceleration(robot, at, v_hat, theta_hat)  # (29)
    W = regressor(robot, at, v_hat, a_hat)  # (10), (31)
    return Rates(a_hat - K @ dv, Gamma @ (W.T @ dv))  # (44), (45)


def step(
    robot: Regressors,
    K: Array,
    Gamma: Array,
    moments: Sequence[Moment],
    v_hat: Array,
    theta_hat: Array,
) -> tuple[Array, Array]:
    """v̂ and θ̂ after a step of RK4 on the update laws.

    `moments` are the robot at the step's begin, half-way and at its end, the command held.
    """
    begin, middle, end = moments
    dt = end.t - begin.t
    state = np.concatenate([v_hat, theta_hat])

    def slope(at: Moment, z: Array) -> Array:
        return np.concatenate(rates(robot, K, Gamma, at, z[: robot.n], z[robot.n :]))

    k1 = slope(begin, state)
    k2 = slope(middle, state + 0.5 * dt * k1)
    k3 = slope(middle, state + 0.5 * dt * k2)
    k4 = slope(end, state + dt * k3)
    after = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return after[: robot.n], after[robot.n :]


def error_system(
    robot: Regressors,
    K: Array,
    Gamma: Array,
    at: Moment,
    v_hat: Array,
    theta_hat: Array,
    theta: Array,
    bases: Bases,
) -> Array:
    """(n+p, n+p) the matrix A of ż = A z, with z = (Δv, θ̄_P⊥, θ̄_P) and θ the true parameters.

    The first block is −(K + M̂⁻¹Ĉ): the paper prints +M̂⁻¹Ĉ, losing the sign of W_C(x, Δv) in (61),
    and leaves P̄_⊥ and P̄ out of the others (docs/paper.md).
    """
    n = robot.n
    P, P_perp = bases
    M_hat = mass_matrix(robot, at.x, theta_hat)
    C_hat = coriolis_matrix(robot, at.x, theta_hat)
    W = regressor_under(robot, at, at.v(n), theta)
    W_hat = regressor_under(robot, at, v_hat, theta_hat)
    k = n + P_perp.shape[1]
    A = np.zeros((n + len(theta),) * 2)
    A[:n, :n] = -K - np.linalg.solve(M_hat, C_hat)  # (65)
    A[:n, n:k] = -np.linalg.solve(M_hat, W @ P_perp)
    A[n:k, :n] = P_perp.T @ Gamma @ W_hat.T
    A[k:, :n] = P.T @ Gamma @ W_hat.T
    return A


# -- IV: stability and parameter convergence -------------------------------------------------------


def lyapunov(
    robot: Regressors,
    Gamma: Array,
    at: Moment,
    v_hat: Array,
    theta_hat: Array,
    theta: Array,
) -> float:
    """V(Δv, Δθ) [J], with θ the true parameters."""
    dv = v_hat - at.v(robot.n)  # (37)
    dtheta = theta_hat - theta  # (38)
    kinetic = 0.5 * dv @ mass_matrix(robot, at.x, theta) @ dv
    return float(kinetic + 0.5 * dtheta @ np.linalg.solve(Gamma, dtheta))  # (66)


def excitation(W: Array, dt: float, P_perp: Array, w: Array) -> float:
    """‖∫ W P̄_⊥ w dτ‖ of one window of samples W (k, n, p), dt [s] apart, for a w (p−r,)."""
    return float(np.linalg.norm(np.sum(W @ P_perp @ w, axis=0) * dt))  # (75)


def excitation_level(W: Array, dt: float, P_perp: Array) -> float:
    """ε₀ of (75) in one window of samples W (k, n, p), dt [s] apart.

    Read literally, (75) holds for no w that is orthogonal to the integral's n rows. Its level is
    that of the Gramian, min over ‖w‖ = 1 of (δ₀ ∫ ‖W P̄_⊥ w‖² dτ)^½, which bounds the literal norm
    from above and is 0 if and only if some direction is never excited.
    """
    B = W @ P_perp
    gramian = np.einsum("kni,knj->ij", B, B) * dt
    return float(np.sqrt(len(W) * dt * max(0.0, np.linalg.eigvalsh(gramian)[0])))  # (75)
