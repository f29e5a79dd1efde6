"""Statements about the memory that docs/theory.md proves, checked numerically."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.linalg import eigh, null_space
from scipy.optimize import minimize

from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.parameters import Array, Block, ParameterSpace
from nsaid_mj.core.quotient import cone as geometry
from tests.support.bench import Bench, Motion, bench, swing

SEEDS = [0, 1, 2]


def kind(name: str, count: int, form: str, actuator: bool = False) -> Block:
    names = tuple(f"{name} {i}" for i in range(count))
    return Block(name, names, ("1",) * count, np.ones(count), form, actuator)  # type: ignore[arg-type]


SPACE = ParameterSpace(
    (
        kind("gain", 2, "positive", actuator=True),
        kind("link", 10, "pseudo_inertia"),
        kind("mass matrix", 6, "spd"),
        kind("friction", 2, "positive"),
        kind("offset", 3, "free"),
    )
)
CONE = geometry.Cone.of(SPACE)
LINK = np.array([2.0, 0.1, -0.2, 0.3, 1.0, 0.1, 1.2, -0.1, 0.05, 0.9])
MIDDLE = np.concatenate(
    [[1.0, 2.0], LINK, [2.0, 0.3, -0.1, 1.5, 0.2, 1.0], [0.5, 1.5], [0.4, -0.3, 0.0]]
)


class Memory(NamedTuple):
    """ψ (its Γ⁻¹ and μ), and R of two rows: w_i, G_i, the diagonals of Σ_i; θ* with G_i θ* = 0."""

    stiffness: Array
    mu: float
    w: Array
    G: Array
    Sigma: Array
    truth: Array
    start: Array

    def psi(self, theta: Array) -> float:
        quadratic = 0.5 * float(theta @ self.stiffness @ theta)
        return quadratic + self.mu * CONE.barrier(theta)

    def slope(self, theta: Array) -> Array:
        """∇ψ."""
        return self.stiffness @ theta + self.mu * CONE.derivatives(theta)[0]

    def metric(self, theta: Array) -> Array:
        """∇²ψ."""
        return self.stiffness + self.mu * CONE.derivatives(theta)[1]

    def bregman(self, theta: Array, other: Array) -> float:
        """D_ψ(θ‖other)."""
        return self.psi(theta) - self.psi(other) - float(self.slope(other) @ (theta - other))

    def Q(self, theta: Array) -> float:
        return float(theta @ self.slope(theta)) - self.psi(theta)

    def size(self, theta: Array) -> Array:
        """(2,) θᵀ Σ_i θ."""
        return self.Sigma @ theta**2

    def quotients(self, theta: Array) -> Array:
        """(2,) λ_i."""
        return np.einsum("j,ijk,k->i", theta, self.G, theta) / self.size(theta)

    def R(self, theta: Array) -> float:
        return 0.5 * float(self.w @ self.quotients(theta))

    def gradient(self, theta: Array) -> Array:
        """∇R."""
        excess = self.G @ theta - self.quotients(theta)[:, None] * self.Sigma * theta
        return (self.w / self.size(theta)) @ excess

    def fall(self, theta: Array) -> float:
        """Σ_i w_i λ_i θ*ᵀ Σ_i θ / θᵀ Σ_i θ, what V loses for each κ dt."""
        shares = (self.Sigma * theta) @ self.truth / self.size(theta)
        return float(self.w * self.quotients(theta) @ shares)

    def curvature(self, theta: Array) -> tuple[Array, Array]:
        """∇²R, and the positive semidefinite part of it that Gauss and Newton take."""
        size, quotients = self.size(theta), self.quotients(theta)
        share = self.w / size
        whole = model = np.tensordot(share, self.G, 1)
        for i in range(2):
            own = self.Sigma[i] * theta
            cross = np.outer(own, self.G[i] @ theta - quotients[i] * own) * 2 / size[i]
            whole = whole - share[i] * (quotients[i] * np.diag(self.Sigma[i]) + cross + cross.T)
        return whole, model

    def implicit(self, theta_hat: Array, reach: float, anchor: float = 0.0) -> Array:
        """θ⁺ with ∇ψ(θ⁺) = ∇ψ(θ̂) − κh ∇(R + w D_ψ(·‖start))(θ⁺), κh = reach, by damped Newton.

        The anchor is a step from the mirror mean of θ̂ and the start, shorter by 1 + κhw.
        """
        more = reach * anchor
        slope = (self.slope(theta_hat) + more * self.slope(self.start)) / (1 + more)
        theta, reach = theta_hat, reach / (1 + more)

        def cost(theta: Array) -> float:
            inside = CONE.contains(theta)
            if not inside:
                return np.inf
            return reach * self.R(theta) + self.psi(theta) - float(slope @ theta)

        for _ in range(100):
            defect = self.slope(theta) - slope + reach * self.gradient(theta)
            whole, model = (self.metric(theta) + reach * part for part in self.curvature(theta))
            convex = np.linalg.eigvalsh(whole)[0] > 0
            step = -np.linalg.solve(whole if convex else model, defect)
            descent, length = -float(defect @ step), 1.0
            if descent < 1e-24 * (1 + reach):
                break
            slack = 1e-13 * (1 + reach)  # rounding
            while cost(theta + length * step) > cost(theta) - 1e-4 * length * descent + slack:
                length *= 0.5
            theta = theta + length * step
        return theta


def memory(seed: int, rank: int = 8, noise: float = 0.0) -> Memory:
    """A random memory on a cone with every kind of block; `noise` > 0 leaves residuals at θ*."""
    rng = np.random.default_rng(seed)
    truth, start = (Prior(SPACE, MIDDLE, 0.8).draw(rng) for _ in range(2))
    rows = rng.standard_normal((2, rank, len(truth)))
    rows -= (rows @ truth)[..., None] * truth / (truth @ truth)
    rows[1, :, 0] = 0.0  # row 2 has the second gain only …
    rows[1, :, 1] -= rows[1] @ truth / truth[1]  # … and Y θ* = 0 all the same
    Sigma = np.zeros((2, len(truth)))
    Sigma[0, :2], Sigma[1, 1] = [1.0, 0.5], 2.0
    G = np.einsum("ikj,ikl->ijl", rows, rows)
    G[:, range(2), range(2)] += noise * Sigma[:, :2]
    A = rng.standard_normal((len(truth), len(truth)))
    return Memory(
        np.eye(len(truth)) + 0.02 * A @ A.T, 0.7, np.array([1.0, 0.3]), G, Sigma, truth, start
    )


# -- momentum form -------------------------------------------------------------------------------


def transposed(table: Bench, x: Array) -> Array:
    """(n, p) regressor of C(x, θ)ᵀ v, by the columns of C (9)."""
    C = np.stack([table.system.W_C(x, e) for e in np.eye(table.system.n)])  # [j, i, k]: C_ij of θ_k
    return np.einsum("jik,i->jk", C, table.system.split(x)[1])


def motions() -> dict[str, tuple[Bench, Motion]]:
    rov = bench("bluerov2")
    rng = np.random.default_rng(5)
    q, v, u = rov.system.random_state(rng)
    return {
        "double_pendulum": swing(),
        "bluerov2": (rov, Motion(rov.system, rov.truth, q, v, u, seconds=0.8)),
    }


@pytest.fixture(scope="module", params=["double_pendulum", "bluerov2"])
def filtered(request) -> tuple[Bench, Array, Array, Array, float]:
    """(table, t, Y (N, n, p) of the leaky filter, W (N, n, p) with the true v̇, a)."""
    table, motion = motions()[request.param]
    system, u, a = table.system, motion.u, 3.0
    n, p = system.n, system.p

    def W_M(t: float) -> Array:
        x = motion.x(t)
        return system.W_M(x, system.split(x)[1])

    def rate(t: float, z: Array) -> Array:
        Psi = system.F(t, motion.x(t), u) + transposed(table, motion.x(t))
        return -a * z + (a * W_M(t) + Psi).ravel()

    t = np.linspace(0, motion.seconds, 161)
    z = solve_ivp(
        rate,
        (0, motion.seconds),
        W_M(0).ravel(),
        method="RK45",
        t_eval=t,
        rtol=1e-10,
        atol=1e-12,
        max_step=0.02,
    ).y.T.reshape(-1, n, p)
    x = motion.x(t).T
    v = system.split(x)[1]
    held = np.broadcast_to(u, (len(t), len(u)))
    acceleration = system.acceleration(t, x, v, held, table.truth)
    Y = np.stack([W_M(s) for s in t]) - z
    return table, t, Y, system.regressor(t, x, v, acceleration, held), a


def test_the_momentum_filter_has_the_truth_in_its_nullspace(filtered):
    """Y θ* = 0 without an acceleration, for all of P_s(θ); another θ leaves a residual."""
    table, _, Y, _, _ = filtered
    size = np.abs(Y * table.truth).max()
    members = table.nullspace.P * table.system.space.scale[:, None]
    members *= np.abs(table.truth / table.system.space.scale).max()
    assert np.abs(Y @ table.truth).max() < 1e-7 * size
    assert np.abs(Y @ members).max() < 1e-6 * size
    assert np.abs(Y @ table.prior(0.3)).max() > 1e-3 * size


def test_the_momentum_filter_is_the_regressor_through_a_low_pass(filtered):
    """Y(t) = ∫ e^{−a(t−τ)} W dτ: the regressor (10) with its true v̇ through 1/(s + a)."""
    table, t, Y, W, a = filtered
    grown = np.exp(a * t)[:, None, None]
    integral = cumulative_trapezoid(W * grown, t, axis=0, initial=0) / grown
    scale = table.system.space.scale
    assert np.abs((Y - integral) * scale).max() < 2e-3 * np.abs(Y * scale).max()


def test_the_momentum_filter_loses_no_direction():
    """Y θ ≡ 0 exactly where W θ ≡ 0: both leave the same directions of the vehicle's θ unknown."""
    table = bench("scalar_rov")
    motion = Motion(
        table.system, table.truth, np.zeros(1), np.array([1.0]), np.array([0.3]), seconds=3.0
    )
    t, a = np.linspace(0, 3, 601), 2.0
    x = motion.x(t).T
    v, held = x[:, 1:], np.broadcast_to(motion.u, (len(t), 1))
    W = table.system.regressor(t, x, v, table.system.acceleration(t, x, v, held, table.truth), held)
    grown = np.exp(a * t)[:, None, None]
    Y = cumulative_trapezoid(W * grown, t, axis=0, initial=0) / grown
    scale = table.system.space.scale
    null_of_W, null_of_Y = (null_space((A * scale)[:, 0], rcond=1e-6) for A in (W, Y))
    assert null_of_W.shape == null_of_Y.shape == (4, 2)  # the scale, and g/a under a held command
    assert np.linalg.norm(null_of_W - null_of_Y @ (null_of_Y.T @ null_of_W)) < 1e-4


# -- the quotient and its flow -------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_the_quotient_has_no_slope_along_the_estimate(seed):
    """R(sθ) = R(θ), so θᵀ ∇R = 0; ∇R by differences."""
    m, rng = memory(seed, noise=0.1), np.random.default_rng(seed)
    gradient = m.gradient(m.start)
    assert m.R(3.7 * m.start) == pytest.approx(m.R(m.start), rel=1e-12)
    assert abs(m.start @ gradient) < 1e-12 * np.linalg.norm(m.start) * np.linalg.norm(gradient)
    for step in 1e-6 * rng.standard_normal((5, len(m.start))):
        rise = m.R(m.start + step) - m.R(m.start - step)
        assert rise == pytest.approx(2 * gradient @ step, rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_true_set_sees_the_quotient_fall(seed):
    """θ*ᵀ ∇R = −Σ w_i λ_i θ*ᵀΣ_iθ̂/θ̂ᵀΣ_iθ̂ ≤ −2 R e^{−1−D/μ}, D = D_ψ(θ*‖θ̂), if G_i θ* = 0."""
    m, rng = memory(seed), np.random.default_rng(seed)
    for error in (0.1, 0.5, 1.0, 2.0):
        theta = Prior(SPACE, m.truth, error).draw(rng)
        slope = float(m.truth @ m.gradient(theta))
        assert slope == pytest.approx(-m.fall(theta), rel=1e-9)
        least = float(np.min(m.truth[:2] / theta[:2]))
        assert least >= np.exp(-1 - m.bregman(m.truth, theta) / m.mu)
        assert slope <= -2 * m.R(theta) * least < 0


@pytest.mark.parametrize("seed", SEEDS)
def test_noise_that_is_what_the_quotient_expects_does_no_harm(seed):
    """G_i = G_i⁰ + ν Σ_i: the fall is Σ w_i (λ_i − ν) …, λ_i ≥ ν, and θ* stays the minimiser."""
    m, nu = memory(seed, noise=0.4), 0.4
    shares = (m.Sigma * m.start) @ m.truth / m.size(m.start)
    expected = -(m.w * (m.quotients(m.start) - nu)) @ shares
    assert m.truth @ m.gradient(m.start) == pytest.approx(expected, rel=1e-9)
    assert (m.quotients(m.start) > nu).all()
    assert m.quotients(m.truth) == pytest.approx([nu, nu], rel=1e-9)
    assert np.abs(m.gradient(m.truth)).max() < 1e-9 * np.abs(m.gradient(m.start)).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_residual_at_the_truth_lets_v_rise_by_no_more_than_it_explains(seed):
    """θ*ᵀ ∇R(θ̂) ≤ ½ R(θ*) max θ*_j/θ̂_j for any G_i ⪰ 0, and no less will do."""
    m, rng = memory(seed), np.random.default_rng(seed)
    rows = 0.3 * rng.standard_normal((2, 5, len(m.truth)))
    m = m._replace(G=m.G + np.einsum("ikj,ikl->ijl", rows, rows))
    rose = 0
    for error in np.geomspace(1e-3, 2, 60):
        theta = Prior(SPACE, m.truth, error).draw(rng)
        slope = float(m.truth @ m.gradient(theta))
        assert slope <= 0.5 * m.R(m.truth) * np.max(m.truth[:2] / theta[:2])
        rose += slope > 0
    assert rose > 0
    # one row y = (1, −1) of a gain and a mass, θ* = (1, 0.7): the bound is met at θ = (1, 0.85)
    y, Sigma = np.array([1.0, -1.0]), np.array([1.0, 0.0])
    truth, theta = np.array([1.0, 0.7]), np.array([1.0, 0.85])
    slope = truth @ (y * (y @ theta) - (y @ theta) ** 2 * Sigma * theta)
    assert slope == pytest.approx(0.5 * 0.5 * (y @ truth) ** 2, rel=1e-12)


def test_the_flow_with_memory_meets_its_rate():
    """(44) and (45) in the cone's metric with −κ(∇²ψ)⁻¹∇R, along a pendulum's motion, to 1e-7.

    V̇ = −Δvᵀ M K Δv − κ Σ w_i λ_i θ*ᵀΣ_iθ̂/θ̂ᵀΣ_iθ̂ is an equality; θ̂ᵀ∇ψ − ψ does not move. The
    memory is of another motion, its Σ_i those of each joint's motor.
    """
    table, motion = swing()
    system, truth, K, kappa, mu = table.system, table.truth, 20.0, 0.3, 0.2
    n, p, scale = system.n, system.p, system.space.scale
    cone = geometry.Cone.of(system.space)
    motors = system.space.actuators
    assert [system.space.names[k] for k in motors] == ["gain_1", "gain_2"]
    _, x, v, u = table.states(12)
    rows = system.regressor(0.0, x, v, system.acceleration(0.0, x, v, u, truth), u)
    G = np.einsum("kij,kil->ijl", rows, rows)
    Sigma = np.zeros((n, p))
    Sigma[range(n), motors] = 1.0
    stiffness = np.diag(1 / scale**2)
    start = Prior(system.space, truth, 0.3).draw(np.random.default_rng(7))

    def quotient(theta: Array) -> tuple[Array, float]:
        size = Sigma @ theta**2
        values = np.einsum("j,ijk,k->i", theta, G, theta) / size
        gradient = (1 / size) @ (G @ theta - values[:, None] * Sigma * theta)
        return gradient, float(values @ ((Sigma * theta) @ truth / size))

    def rate(t: float, y: Array) -> Array:
        x, v_hat, theta = motion.x(t), y[:n], y[n : n + p]
        dv = v_hat - system.split(x)[1]
        a_hat = system.acceleration(t, x, v_hat, motion.u, theta)
        W = system.regressor(t, x, v_hat, a_hat, motion.u)
        gradient, fall = quotient(theta)
        metric = stiffness + mu * cone.derivatives(theta)[1]
        theta_rate = np.linalg.solve(metric, W.T @ dv - kappa * gradient)
        lost = K * float(dv @ system.mass_matrix(x, truth) @ dv)
        losses = np.array([lost, kappa * fall])
        return np.concatenate([a_hat - K * dv, theta_rate, losses], dtype=np.float64)

    y = solve_ivp(
        rate,
        (0, 0.4),
        np.concatenate([system.split(motion.x(0))[1] + 0.5, start, [0, 0]]),
        rtol=1e-9,
        atol=1e-12,
        t_eval=np.linspace(0, 0.4, 21),
    )
    t, y = y.t, y.y.T

    def V(t: float, y: Array) -> float:
        x, theta = motion.x(t), y[n : n + p]
        dv = y[:n] - system.split(x)[1]
        slope = stiffness @ theta + mu * cone.derivatives(theta)[0]
        bregman = 0.5 * (truth @ stiffness @ truth - theta @ stiffness @ theta) + mu * (
            cone.barrier(truth) - cone.barrier(theta)
        )
        kinetic = 0.5 * dv @ system.mass_matrix(x, truth) @ dv
        return float(kinetic + bregman - slope @ (truth - theta))

    values = np.array([V(*pair) for pair in zip(t, y, strict=True)])
    lost = y[:, -2:].sum(axis=1)
    assert np.abs(values + lost - values[0]).max() < 1e-6 * lost[-1]
    assert (y[-1, -2:] > 0.05 * lost[-1]).all()  # both terms take their part
    theta = y[:, n : n + p]
    conserved = [0.5 * th @ stiffness @ th - mu * cone.barrier(th) for th in theta]
    assert np.ptp(conserved) < 1e-7 * abs(conserved[0])


# -- implicit steps ------------------------------------------------------------------------------


@pytest.mark.parametrize("reach", [1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("seed", SEEDS)
def test_an_implicit_step_lowers_v_at_any_size(seed, reach):
    """D_ψ(θ*‖θ̂) − D_ψ(θ*‖θ⁺) = D_ψ(θ⁺‖θ̂) + κh Σ w_i λ_i⁺ …, and Q falls by D_ψ(θ⁺‖θ̂)."""
    m = memory(seed)
    after = m.implicit(m.start, reach)
    cost = m.bregman(after, m.start)
    fall = m.bregman(m.truth, m.start) - m.bregman(m.truth, after)
    assert CONE.contains(after)
    assert 0 < cost < fall
    assert fall == pytest.approx(cost + reach * m.fall(after), rel=1e-6)
    assert m.Q(m.start) - m.Q(after) == pytest.approx(cost, rel=1e-6)
    assert m.R(after) < m.R(m.start)


@pytest.mark.parametrize("seed", SEEDS)
def test_small_implicit_steps_keep_the_conserved_quantity(seed):
    """Over a given κt the loss of Q is of order h."""
    m, counts, losses = memory(seed), np.array([10, 20, 40, 80]), []
    for count in counts:
        theta = m.start
        for _ in range(count):
            theta = m.implicit(theta, 2.0 / count)
        losses.append(m.Q(m.start) - m.Q(theta))
    assert min(losses) > 0
    slope = np.polyfit(np.log(1 / counts), np.log(losses), 1)[0]
    assert 0.85 < slope < 1.1


@pytest.mark.parametrize("seed", SEEDS)
def test_implicit_steps_converge_to_the_predicted_member(seed):
    """Into N = {Gθ = 0}, to one point; n·∇ψ stands for every n of N without an actuator.

    What is left is bounded by what V was: Σ κh 2R e^{−1−V/μ} ≤ V(0) and Q(0) − Q(∞) ≤ V(0).
    """
    m, reach = memory(seed, rank=5), 100.0
    N = null_space(m.G.sum(axis=0), rcond=1e-9)
    silent = N @ null_space(N[:2])  # members of N that no actuator has a part in
    assert N.shape[1] == 13 and silent.shape[1] == 11
    theta, path = m.start, [m.start]
    for _ in range(60):
        theta = m.implicit(theta, reach)
        path.append(theta)
    off = [np.linalg.norm(th - N @ (N.T @ th)) / np.linalg.norm(th) for th in path]
    assert off[0] > 0.1 and off[-1] < 1e-6
    V0 = m.bregman(m.truth, m.start)
    assert sum(reach * 2 * m.R(th) for th in path[1:]) * np.exp(-1 - V0 / m.mu) <= V0
    assert 0 < m.Q(m.start) - m.Q(theta) <= V0 - m.bregman(m.truth, theta)
    moved = np.linalg.norm(silent.T @ (theta - m.start))
    assert np.abs(silent.T @ (m.slope(theta) - m.slope(m.start))).max() < 1e-7 * moved
    assert np.linalg.norm(path[-1] - path[-2]) < 1e-6 * np.linalg.norm(path[1] - path[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_residuals_do_not_move_what_no_row_observes(seed):
    """n·∇ψ stands at any residual: the unobserved cannot grow, whatever the noise."""
    m, theta = memory(seed, rank=5, noise=3.0), memory(seed, rank=5, noise=3.0).start
    N = null_space(np.vstack([m.G.sum(axis=0), np.eye(len(theta))[:2]]), rcond=1e-9)
    for _ in range(10):
        theta = m.implicit(theta, 10.0)
    assert m.R(theta) > 1.0
    moved = np.linalg.norm(m.slope(theta) - m.slope(m.start))
    assert moved > 0.1 and np.abs(N.T @ (m.slope(theta) - m.slope(m.start))).max() < 1e-7 * moved


# -- the two traps -------------------------------------------------------------------------------


def test_trap_1_with_the_metric_as_normaliser_the_unobserved_grows():
    """Σ = ∇²b: an unobserved number of the cone obeys θ̇ = κwλθ, without end; Σ on the gain: θ̇ = 0.

    θ = (gain, mass, unobserved mass), all > 0, with residuals that no θ makes 0. Q = Σ log θ stays,
    so what is observed shrinks, λ with it, and growth is linear for w = 1; with w = 1/λ, a variance
    re-estimated from the residuals, it is e^κt.
    """
    G = np.zeros((3, 3))
    G[:2, :2] = [[1.0, -1.0], [-1.0, 1.5]]

    def end(seconds: float, in_metric: bool, reweighted: bool) -> Array:
        def rate(t: float, eta: Array) -> Array:  # η = log θ
            theta = np.exp(eta)
            H, Sigma = np.diag(theta**-2.0), np.diag([1.0, 0.0, 0.0])
            Sigma = H if in_metric else Sigma
            quotient = theta @ G @ theta / (theta @ Sigma @ theta)
            w = 1 / quotient if reweighted else 1.0
            excess = w * (G @ theta - quotient * Sigma @ theta)
            return -np.linalg.solve(H, excess) / theta

        start = np.log([1.0, 0.5, 1.0])
        eta = solve_ivp(rate, (0, seconds), start, rtol=1e-9, atol=1e-12).y[:, -1]
        assert eta.sum() == pytest.approx(start.sum(), abs=1e-6)
        return np.exp(eta)

    once, twice = end(200, True, False), end(400, True, False)
    assert once[2] > 10 and twice[2] / once[2] == pytest.approx(2, rel=0.1)
    assert twice[0] < once[0] < 0.5  # the gain pays for it
    assert end(30, True, True)[2] == pytest.approx(np.exp(30), rel=1e-4)
    for reweighted in (False, True):
        stayed = end(200, False, reweighted)
        assert stayed[2] == 1.0
        assert stayed[0] / stayed[1] == pytest.approx(1.5, rel=1e-3)  # the quotient's minimum


@pytest.mark.parametrize(("unit", "total"), [(1.0, 0.618034), (10.0, 0.501248), (0.1, 0.9901)])
def test_trap_2_total_least_squares_depends_on_units(unit, total):
    """m v̇ = k u with m = k = 1, noise on u as strong as u: E G = [[1, −1], [−1, 2]].

    Σ on the gain finds k/m = 1 in any unit of the gain; Euclid's norm finds what the unit says;
    ordinary least squares of v̇ on u finds a half.
    """
    S = np.diag([1.0, unit])
    G = S @ np.array([[1.0, -1.0], [-1.0, 2.0]]) @ S
    m, k = np.linalg.eigh(G)[1][:, 0]
    assert unit * k / m == pytest.approx(total, abs=1e-5)
    least = (1 + 2 * unit**2 - np.sqrt(1 + 4 * unit**4)) / 2
    assert unit * k / m == pytest.approx(1 - least, rel=1e-9)
    inverse, vectors = eigh(np.diag([0.0, 1.0]), G)  # Σθ = θᵀΣθ/θᵀGθ Gθ: the largest is 1/λ
    m, k = vectors[:, np.argmax(inverse)]
    assert unit * k / m == pytest.approx(1.0, rel=1e-9)


def test_noise_of_the_sensors_bends_even_the_right_quotient():
    """Noise on v̇ instead: E G = [[1 + s, −1], [−1, 1]] has k/m = 1 + s; G − N has 1 again."""
    G, N, Sigma = np.array([[1.3, -1.0], [-1.0, 1.0]]), np.diag([0.3, 0.0]), np.diag([0.0, 1.0])
    for Gramian, expected in ((G, 1.3), (G - N + 1e-12 * np.eye(2), 1.0)):
        inverse, vectors = eigh(Sigma, Gramian)
        m, k = vectors[:, np.argmax(inverse)]
        assert k / m == pytest.approx(expected, rel=1e-5)


# -- the anchor ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_the_anchor_pulls_no_further_than_the_start_was_off(seed):
    """(1 + β) D* falls as it must, D* = D_ψ(θ*‖θ̂) never exceeds D_ψ(θ*‖θ̂₀), and Q moves."""
    m, reach, anchor = memory(seed), 2.0, 0.3
    beta, first = reach * anchor, m.bregman(m.truth, m.start)
    theta = m.implicit(m.start, 1e3)  # where the data alone lead
    distances, losses = [m.bregman(m.truth, theta)], []
    for _ in range(40):
        after = m.implicit(theta, reach, anchor)
        left = (
            m.bregman(m.truth, theta)
            + beta * first
            - m.bregman(after, theta)
            - beta * m.bregman(after, m.start)
            - reach * m.fall(after)
        )
        distances.append(m.bregman(m.truth, after))
        losses.append(m.Q(theta) - m.Q(after) - m.bregman(after, theta))
        assert (1 + beta) * distances[-1] == pytest.approx(left, rel=1e-7)
        theta = after
    assert max(distances) <= first
    assert max(np.diff(distances)) > 0  # no longer monotone
    assert max(np.abs(losses)) > 1e-3  # nor does Q fall by a step's cost alone
    pull = m.slope(theta) - m.slope(m.start)
    defect = np.abs(m.gradient(theta) + anchor * pull).max()
    assert defect < 1e-4 * np.abs(pull).max()  # it comes to rest at the MAP …
    assert abs(theta @ pull) < 1e-4 * np.linalg.norm(theta) * np.linalg.norm(pull)  # … and a scale


def test_the_anchor_is_a_gamma_or_wishart_prior_with_its_mode_at_the_start():
    """exp(−w D_b(θ‖θ₀)) is θ^w e^{−wθ/θ₀}: shape w + 1, scale θ₀/w; so for a matrix, Wishart."""
    w, P0 = 1.7, np.array([[2.0, 0.3], [0.3, 1.0]])

    def density(entries: Array) -> float:
        P = np.array([[entries[0], entries[1]], [entries[1], entries[2]]])
        return -w * (np.linalg.slogdet(P)[1] - np.trace(np.linalg.solve(P0, P)))

    found = minimize(
        density, [1.0, 0.0, 1.0], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12}
    ).x
    assert found == pytest.approx([2.0, 0.3, 1.0], abs=1e-6)


# -- the filter ----------------------------------------------------------------------------------


def scale_information(carried: bool, shorten: bool, noise: float = 0.0) -> Array:
    """ϑᵀ P_θθ⁻¹ ϑ along (K1, K2) with Γ ϑ = 0 at the ϑ of every step, over the prior's."""
    rng, n, p = np.random.default_rng(0), 4, 7
    theta, H = rng.uniform(0.5, 1.5, p), np.eye(n, n + p)
    P = np.zeros((n + p, n + p))
    P[:n, :n], P[n:, n:] = 1e-4 * np.eye(n), np.diag(rng.uniform(0.01, 0.1, p))
    found, before = [], theta @ np.linalg.solve(P[n:, n:], theta)
    for k in range(200):
        F = np.eye(n + p)
        F[:n, :n] += 0.1 * rng.standard_normal((n, n))
        drive = 0.1 * rng.standard_normal((n, p))
        F[:n, n:] = drive - np.outer(drive @ theta, theta) / (theta @ theta)
        P = F @ P @ F.T
        P[:n, :n] += 0.09 * np.diag(np.diag(F[:n, n:] @ P[n:, n:] @ F[:n, n:].T))  # γ
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + 1e-4 * np.eye(n))
        gain[n:] *= rng.uniform() if shorten and k % 2 else 1.0
        step = np.eye(n + p) - gain @ H
        P = step @ P @ step.T + 1e-4 * gain @ gain.T
        T = np.eye(n + p)
        moved = 0.05 * rng.standard_normal(p)
        T[n:, n:] += np.outer(moved, theta) / (theta @ theta)
        theta = theta + moved
        P = T @ P @ T.T if carried else P
        P[n:, n:] += noise * np.diag(rng.uniform(0, 1, p))
        found.append(theta @ np.linalg.solve(P[n:, n:], theta))
    return np.array(found) / before


@pytest.mark.parametrize("shorten", [False, True])
def test_the_data_say_nothing_of_the_scale(shorten):
    assert scale_information(True, shorten) == pytest.approx(1.0, rel=1e-6)
    assert scale_information(False, shorten)[-1] > 2  # spurious information
    noisy = scale_information(True, shorten, noise=1e-4)
    assert noisy.max() <= 1 + 1e-6 and noisy[-1] < 0.9


def test_a_shortened_step_learns_its_share():
    """Joseph's form with a K_θ: P_θθ loses a (2 − a) K_θ S K_θᵀ, and P_xθ the whole K_x S K_θᵀ."""
    rng, n, p, a = np.random.default_rng(1), 3, 4, 0.3
    root, H = rng.standard_normal((n + p, n + p)), np.eye(n, n + p)
    P, R = root @ root.T, np.diag(rng.uniform(0.5, 1.5, n))
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    short = np.concatenate([K[:n], a * K[n:]])
    step = np.eye(n + p) - short @ H
    joseph, whole = step @ P @ step.T + short @ R @ short.T, K @ S @ K.T
    assert joseph[n:, n:] == pytest.approx(P[n:, n:] - a * (2 - a) * whole[n:, n:])
    assert joseph[:n, n:] == pytest.approx(P[:n, n:] - whole[:n, n:])
