"""The cone of physical parameters: its barrier, its chart, and the law in its metric."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.cone import chart
from nsaid_mj.core.laws.cone.law import ACCURACY, ConeMetric
from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier, paper_identifier
from nsaid_mj.core.parameters import Block, ParameterSpace
from nsaid_mj.core.quotient import barrier
from nsaid_mj.core.quotient import cone as geometry
from nsaid_mj.lab.setup import Seeds
from tests.support.bench import estimates, identify
from tests.support.dense import from_chart, rk4_step, to_chart
from tests.support.remembered import driven, scenario_plant
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=15)
MOTION = Seeds.of(0).excitation
NAMES = ["bluerov2", "remus100", "double_pendulum"]
plants = pytest.mark.parametrize("name", NAMES)


def inside(name: str, seed: int, error: float = 0.3) -> np.ndarray:
    p = scenario_plant(name)
    rng = np.random.default_rng(seed)
    return Prior(p.system.space, p.truth, error).draw(rng)


def build(name: str, prior: np.ndarray, gain: float = 1.0, mu: float = 1.0) -> NullspaceIdentifier:
    system, dt = scenario_plant(name).system, scenario_plant(name).dt
    metric = ConeMetric(system.space, gain * system.space.scale**2, prior, mu)
    return NullspaceIdentifier(system, np.full(system.n, 6.0), metric, prior, dt)


def natural_rate(cone, eta, theta, stiffness, mu, gradient):
    """(p,) η̇ of the cone's law."""
    rate, room = np.empty(len(eta)), chart.chart_of(cone)
    if stiffness.ndim == 1:
        chart.natural_rate_into(cone, eta, theta, stiffness, mu, gradient, rate, room)
    else:
        chart.dense_rate_into(cone, eta, theta, stiffness, mu, gradient, rate)
    return rate


# -- geometry ----------------------------------------------------------------------------------


@plants
@FEW
@given(seeds, st.floats(0, 2))
def test_drawn_estimates_are_inside_the_cone_and_survive_the_chart(name, seed, error):
    cone, theta = geometry.Cone.of(scenario_plant(name).system.space), inside(name, seed, error)
    assert cone.contains(theta) and np.isfinite(cone.barrier(theta))
    again = from_chart(cone, to_chart(cone, theta), geometry.coordinates(cone))
    np.testing.assert_allclose(again, theta, rtol=1e-9, atol=1e-12 * np.abs(theta).max())


@pytest.mark.parametrize("name", ["bluerov2", "double_pendulum"])  # a tied matrix has no such chart
@FEW
@given(seeds)
def test_any_chart_point_is_inside(name, seed):
    cone = geometry.Cone.of(scenario_plant(name).system.space)
    eta = np.random.default_rng(seed).uniform(-2, 2, scenario_plant(name).system.p)
    theta = from_chart(cone, eta, geometry.coordinates(cone))
    assert cone.contains(theta)


@FEW
@given(seeds, st.floats(0, 2))
def test_a_drawn_tied_matrix_keeps_a_share_of_its_distance_to_the_edge(seed, error):
    truth, theta = scenario_plant("remus100").truth, inside("remus100", seed, error)
    place = scenario_plant("remus100").system.space["mass matrix"]
    assert np.abs(np.log((theta / truth)[place][:4])).max() <= error + 1e-12
    least = [np.linalg.eigvalsh(balanced(mass_of_a_torpedo(th[place])))[0] for th in (truth, theta)]
    assert least[1] >= np.exp(-error) * least[0] - 1e-12
    if error == 0:
        np.testing.assert_array_equal(theta[place], truth[place])


def test_a_tied_matrix_on_the_edge_is_drawn_inside():
    space, truth = scenario_plant("remus100").system.space, scenario_plant("remus100").truth.copy()
    place = space["mass matrix"]
    truth[place.start + 4] = np.sqrt(truth[place][1] * truth[place][3])  # M_26² = M_22 M_55
    cone, rng = geometry.Cone.of(space), np.random.default_rng(0)
    assert not cone.contains(truth)
    for error in (0.0, 0.3, 1.0):
        theta = Prior(space, truth, error).draw(rng)
        assert cone.contains(theta)
        M = mass_of_a_torpedo(theta[place])
        assert np.linalg.eigvalsh(balanced(M))[0] >= 0.999e-3 * np.exp(-error)


def mass_of_a_torpedo(theta: np.ndarray) -> np.ndarray:
    """Prestero (2001)'s M of (M_11, M_22, M_44, M_55, M_26, M_15), axes as in the package."""
    a, b, c, d, e, f = theta
    return np.array(
        [
            [a, 0, 0, 0, f, 0],
            [0, b, 0, -f, 0, e],
            [0, 0, b, 0, -e, 0],
            [0, -f, 0, c, 0, 0],
            [f, 0, -e, 0, d, 0],
            [0, e, 0, 0, 0, d],
        ]
    )


def balanced(M: np.ndarray) -> np.ndarray:
    scale = 1 / np.sqrt(np.diag(M))
    return M * np.outer(scale, scale)


def test_the_torpedos_block_is_its_mass_matrix():
    system, truth = scenario_plant("remus100").system, scenario_plant("remus100").truth
    cone, x = geometry.Cone.of(system.space), np.r_[system.position(np.zeros(6)), np.zeros(6)]
    M = geometry.matrix(cone, 0, truth)
    M += np.tril(M, -1).T
    np.testing.assert_array_equal(M, system.mass_matrix(x, truth))
    np.testing.assert_array_equal(M, mass_of_a_torpedo(truth[system.space["mass matrix"]]))


@plants
@FEW
@given(seeds)
def test_the_barrier_is_logarithmically_homogeneous(name, seed):
    """b(sθ) = b(θ) − ν log s, so ∇b·θ = −ν and ∇²b θ = −∇b."""
    cone, theta = geometry.Cone.of(scenario_plant(name).system.space), inside(name, seed)
    gradient, hessian = cone.derivatives(theta)
    own = np.diag(hessian) > 0  # parameters of the cone; the others have no barrier
    assert gradient @ theta == pytest.approx(-cone.degree)
    np.testing.assert_allclose(
        hessian @ np.where(own, theta, 0), -gradient, rtol=1e-6, atol=1e-9 * np.abs(gradient).max()
    )
    fall = cone.barrier(theta) - cone.barrier(3 * theta)
    assert fall == pytest.approx(cone.degree * np.log(3))


@plants
@FEW
@given(seeds)
def test_gradient_and_hessian_match_finite_differences(name, seed):
    cone, theta = geometry.Cone.of(scenario_plant(name).system.space), inside(name, seed, 0.2)
    step = 1e-6 * (inside(name, seed + 1, 0.2) - theta)
    plus, minus = theta + step, theta - step
    gradient, hessian = cone.derivatives(theta)
    rise = cone.barrier(plus) - cone.barrier(minus)
    assert rise == pytest.approx(2 * gradient @ step, rel=1e-4, abs=1e-9)
    turn = cone.derivatives(plus)[0] - cone.derivatives(minus)[0]
    np.testing.assert_allclose(turn, 2 * hessian @ step, atol=1e-5 * np.abs(turn).max())
    eta = to_chart(cone, theta)
    moved = to_chart(cone, plus) - to_chart(cone, minus)
    rate = chart.chart_rate(cone, eta, step)
    np.testing.assert_allclose(moved, 2 * rate, atol=1e-5 * np.abs(moved).max())


# -- the compiled code against dense formulas --------------------------------------------------


TIES = ((2, 2, 1, 1.0), (0, 0, 0, 1.0), (1, 1, 0, 2.0), (1, 0, 2, -1.0), (2, 1, 2, 0.5))


def block(name: str, count: int, geometry) -> Block:
    names = tuple(f"{name} {i}" for i in range(count))
    entries = TIES if geometry == "tied" else ()
    return Block(name, names, ("-",) * count, np.ones(count), geometry, entries=entries)


MIXED = ParameterSpace(
    (
        block("drag", 2, "free"),
        block("link", 10, "pseudo_inertia"),
        block("gain", 3, "positive"),
        block("mass", 6, "spd"),
        block("link 2", 10, "pseudo_inertia"),
        block("one", 1, "spd"),
        block("body", 21, "spd"),
        block("tied", 3, "tied"),
        block("lift", 1, "free"),
    )
)
CONE, PAIRING = geometry.Cone.of(MIXED), geometry.coordinates(geometry.Cone.of(MIXED))


def pseudo_inertia(phi: np.ndarray) -> np.ndarray:
    """[[½ tr(I) 1 − I, h], [hᵀ, m]] of φ = (m, h, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)."""
    m, h, (xx, xy, yy, xz, yz, zz) = phi[0], phi[1:4], phi[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.block([[0.5 * np.trace(inertia) * np.eye(3) - inertia, h[:, None]], [h[None], m]])


def dense(part: Block, theta: np.ndarray) -> np.ndarray:
    """A matrix block's P, from its definition."""
    if part.geometry == "pseudo_inertia":
        return pseudo_inertia(theta)
    if part.geometry == "tied":
        a, b, c = theta
        return np.array([[a, -c, 0], [-c, 2 * a, 0.5 * c], [0, 0.5 * c, b]])
    k = round((2 * len(theta)) ** 0.5 - 0.5)
    P = np.zeros((k, k))
    P[np.triu_indices(k)] = theta
    return P + np.triu(P, 1).T


def physical(rng: np.random.Generator) -> np.ndarray:
    """θ of MIXED, its matrices drawn, not its parameters."""
    theta = rng.uniform(0.2, 2, len(MIXED))
    for part, place in MIXED:
        if part.geometry in ("pseudo_inertia", "spd"):
            columns = np.array([dense(part, e).ravel() for e in np.eye(len(part))]).T
            k = round(columns.shape[0] ** 0.5)
            A = rng.standard_normal((k, k))
            theta[place] = np.linalg.lstsq(columns, (A @ A.T + 0.2 * np.eye(k)).ravel())[0]
        elif part.geometry == "tied":
            a, b = theta[place][:2]
            theta[place.stop - 1] = rng.uniform(-1, 1) / np.sqrt(0.5 / a**2 + 0.125 / (a * b))
    return theta


def dense_hessian(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    gradient, hessian = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    for part, place in MIXED:
        if part.geometry == "positive":
            gradient[place] = -1 / theta[place]
            hessian[place, place] = np.diag(theta[place] ** -2.0)
        elif part.geometry != "free":
            inverse = np.linalg.inv(dense(part, theta[place]))
            X = np.array([inverse @ dense(part, e) for e in np.eye(len(part))])
            gradient[place] = -np.trace(X, axis1=1, axis2=2)
            hessian[place, place] = np.einsum("iab,jba->ij", X, X)
    return gradient, hessian


@FEW
@given(seeds)
def test_the_barrier_and_its_derivatives_are_those_of_the_dense_matrices(seed):
    theta = physical(np.random.default_rng(seed))
    value = -sum(
        np.linalg.slogdet(dense(part, theta[place]))[1]
        for part, place in MIXED
        if part.geometry in ("pseudo_inertia", "spd", "tied")
    )
    value -= np.log(theta[MIXED["gain"]]).sum()
    assert CONE.barrier(theta) == pytest.approx(value, rel=1e-10, abs=1e-10)
    assert CONE.degree == 3 + 4 + 3 + 4 + 1 + 6 + 3
    for own, expected in zip(CONE.derivatives(theta), dense_hessian(theta), strict=True):
        np.testing.assert_allclose(own, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def theta_rate_of(space: ParameterSpace, theta: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """θ̇ of an η̇, by P = L Lᵀ, differentiated."""
    theta_rate = rate.copy()
    for part, place in space:
        if part.geometry == "positive":
            theta_rate[place] *= theta[place]
        elif part.geometry not in ("free", "tied"):
            L = np.linalg.cholesky(dense(part, theta[place]))
            L_rate = np.zeros_like(L)
            L_rate[np.tril_indices(len(L))] = rate[place]
            L_rate[np.diag_indices(len(L))] *= np.diag(L)
            P_rate = L_rate @ L.T + L @ L_rate.T
            columns = np.array([dense(part, e).ravel() for e in np.eye(len(part))]).T
            theta_rate[place] = np.linalg.lstsq(columns, P_rate.ravel())[0]
    return theta_rate


@FEW
@given(seeds, st.floats(1e-3, 1e3))
def test_solving_the_metric_block_by_block_equals_the_dense_solution(seed, mu):
    rng = np.random.default_rng(seed)
    theta, gradient = physical(rng), rng.standard_normal(len(MIXED))
    A = rng.standard_normal((len(MIXED), len(MIXED)))
    diagonal, full = rng.uniform(0.1, 10, len(MIXED)), A @ A.T + np.eye(len(MIXED))
    eta, hessian = to_chart(CONE, theta), dense_hessian(theta)[1]
    kept = eta.copy(), gradient.copy(), diagonal.copy(), full.copy()
    whole, parts = [slice(0, len(MIXED))], [place for _, place in MIXED]
    for stiffness, places in ((diagonal, parts), (full, whole)):
        metric = (np.diag(stiffness) if stiffness.ndim == 1 else stiffness) + mu * hessian
        rate = natural_rate(CONE, eta, theta, stiffness, mu, gradient)
        x = theta_rate_of(MIXED, theta, rate)
        for place in places:  # backward stable: the residual is small whatever the condition
            own = metric[place, place]
            size = np.linalg.norm(own) * np.linalg.norm(x[place])
            assert np.linalg.norm(own @ x[place] - gradient[place]) <= 1e-12 * size
    for own, before in zip((eta, gradient, diagonal, full), kept, strict=True):
        np.testing.assert_array_equal(own, before)


@FEW
@given(seeds)
def test_the_charts_rate_is_that_of_the_cholesky_factor(seed):
    rng = np.random.default_rng(seed)
    theta, theta_rate = physical(rng), rng.standard_normal(len(MIXED))
    eta = to_chart(CONE, theta)
    np.testing.assert_allclose(
        from_chart(CONE, eta, PAIRING), theta, rtol=1e-12, atol=1e-12 * np.abs(theta).max()
    )
    rate = chart.chart_rate(CONE, eta, theta_rate)
    for part, place in MIXED:
        own, expected = rate[place], theta_rate[place]
        if part.geometry == "positive":
            expected = expected / theta[place]
        elif part.geometry not in ("free", "tied"):
            L = np.linalg.cholesky(dense(part, theta[place]))
            X = np.linalg.solve(L, np.linalg.solve(L, dense(part, expected)).T)
            L_rate = L @ (np.tril(X, -1) + 0.5 * np.diag(np.diag(X)))
            L_rate[np.diag_indices(len(L))] /= np.diag(L)
            expected = L_rate[np.tril_indices(len(L))]
        np.testing.assert_allclose(own, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@FEW
@given(seeds, st.integers(1, 19), st.data())
def test_links_do_not_depend_on_their_neighbours(seed, count, data):
    """Each has a SIMD lane: it gets the bits it gets alone, and NaN stays in its own lane."""
    rng = np.random.default_rng(seed)
    links = tuple(block(f"link {i}", 10, "pseudo_inertia") for i in range(count))
    many, one = (geometry.Cone.of(ParameterSpace(part)) for part in (links, links[:1]))
    theta = np.concatenate([physical(rng)[MIXED["link"]] for _ in links])
    bad = data.draw(st.integers(0, count - 1)) if data.draw(st.booleans()) else None
    if bad is not None:
        theta[10 * bad + data.draw(st.integers(0, 9))] = data.draw(st.sampled_from((np.nan, -9e9)))
    stiffness, gradient = rng.uniform(0.1, 10, 10 * count), rng.standard_normal(10 * count)

    def chain(cone, theta, stiffness, gradient):
        eta, pairing = to_chart(cone, theta), geometry.coordinates(cone)
        rate = natural_rate(cone, eta, theta, stiffness, 0.3, gradient)
        return np.array([eta, from_chart(cone, eta, pairing), rate])

    together = chain(many, theta, stiffness, gradient)
    for i in range(count):
        own = slice(10 * i, 10 * i + 10)
        alone = chain(one, theta[own], stiffness[own], gradient[own])
        np.testing.assert_array_equal(together[:, own], alone)
        assert np.isnan(alone).all() if i == bad else np.isfinite(alone).all()


@FEW
@given(seeds, st.floats(-6, 6))
def test_a_step_of_a_tied_matrix_of_any_length_stays_inside(seed, log_length):
    rng = np.random.default_rng(seed)
    theta, step, place = physical(rng), rng.standard_normal(len(MIXED)), MIXED["tied"]
    start = to_chart(CONE, theta)
    end = start + 10**log_length * step
    held = end.copy()
    chart.confine(CONE, start, held)
    others = np.ones(len(MIXED), dtype=bool)
    others[place] = False
    np.testing.assert_array_equal(held[others], end[others])
    P, Q = (dense(MIXED.blocks[-2], theta[place]) for theta in (start, held))
    assert np.linalg.eigvals(np.linalg.solve(P, Q)).real.min() >= 0.1 - 1e-9
    metric, d = dense_hessian(theta)[1][place, place], (end - start)[place]
    length = np.sqrt(d @ metric @ d)
    if length < 0.899:
        np.testing.assert_array_equal(held, end)
    share = min(1.0, 0.9 / length)
    np.testing.assert_allclose((held - start)[place], share * d, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("name", ["gain", "link", "mass", "one", "tied"])
@pytest.mark.parametrize("how", ["outside", "edge", "NaN"])
def test_an_estimate_outside_gives_nan_in_its_own_block_only(name, how):
    theta, place = physical(np.random.default_rng(0)), MIXED[name]
    theta[place] = {"outside": -1.0, "edge": 0.0, "NaN": np.nan}[how] * theta[place]
    assert not CONE.contains(theta) and CONE.barrier(theta) == np.inf
    eta = to_chart(CONE, theta)
    stiffness, gradient = np.ones(len(MIXED)), np.ones(len(MIXED))
    again = from_chart(CONE, eta, PAIRING)
    rate = natural_rate(CONE, eta, again, stiffness, 1.0, gradient)
    slope, _ = CONE.derivatives(theta)
    for seen in (eta, again, rate, slope):
        assert np.isnan(seen[place]).all() and np.isnan(seen).sum() == place.stop - place.start
    full = barrier.metric_solve(CONE, theta, np.diag(stiffness), 1.0, gradient)
    assert np.isnan(full).all()


# -- the law -----------------------------------------------------------------------------------


@plants
def test_v_falls_and_the_conserved_quantity_stays(name):
    p, measured = scenario_plant(name), driven(name, 5.0, seed=MOTION).rows
    law = build(name, inside(name, 1))
    v_hat, theta = estimates(law, measured)
    conserved = law.conserved(theta)
    assert np.abs(conserved / conserved[0] - 1).max() < 1e-6
    V = law.divergence(p.truth, theta)
    for k, m in enumerate(measured):
        dv = v_hat[k] - m.v
        V[k] += 0.5 * dv @ p.system.mass_matrix(np.r_[m.q, m.v], p.truth) @ dv
    assert V[-1] < 0.99 * V[0] and np.diff(V).max() < 1e-6 * V[0]


def test_no_start_and_no_gain_leaves_the_cone():
    """Where constant Γ loses M̂ > 0, the cone's metric does not."""
    cone, lost = geometry.Cone.of(scenario_plant("bluerov2").system.space), 0
    measured = driven("bluerov2", 5.0, seed=MOTION).rows[:200]
    for seed in range(6):
        prior = inside("bluerov2", seed, 1.0)
        _, found = estimates(build("bluerov2", prior, gain=100.0), measured)
        assert all(cone.contains(theta) for theta in found)
        system = scenario_plant("bluerov2").system
        plain = paper_identifier(
            system,
            np.full(6, 6.0),
            100.0 * system.space.scale**2,
            prior,
            scenario_plant("bluerov2").dt,
        )
        state = plain.init(measured[0])
        for before, after in pairwise(measured):
            state = plain.step(state, before, after)
            if state.status is not Status.completed:
                lost += 1
                break
    assert lost > 0


def test_sixty_steps_equal_those_in_numpy():
    measured, law = (
        driven("bluerov2", 5.0, seed=MOTION).rows[:60],
        build("bluerov2", inside("bluerov2", 2)),
    )
    states = identify(law, measured)
    v_hat, theta_hat = states[0].v_hat, states[0].theta_hat
    for pair in pairwise(measured):
        v_hat, theta_hat, _ = rk4_step(law, v_hat, theta_hat, *pair)
    scale = law.system.space.scale
    np.testing.assert_allclose(states[-1].theta_hat / scale, theta_hat / scale, rtol=0, atol=1e-11)
    np.testing.assert_allclose(states[-1].v_hat, v_hat, rtol=0, atol=1e-11)


@plants
@pytest.mark.parametrize("full", [False, True])
def test_a_step_is_rk4_in_the_dense_metric(name, full):
    p, measured = scenario_plant(name), driven(name, 5.0, seed=MOTION).rows
    scale, rng = p.system.space.scale, np.random.default_rng(4)
    A = rng.standard_normal((p.system.p, p.system.p)) / p.system.p**0.5
    Gamma = (0.1 * np.eye(p.system.p) + A @ A.T) * np.outer(scale, scale) if full else scale**2
    K = np.full(p.system.n, 6.0)
    prior = inside(name, 5)
    law = NullspaceIdentifier(
        p.system, K, ConeMetric(p.system.space, Gamma, prior, 1.0), prior, p.dt
    )
    state, moved = law.init(measured[0]), 0.0
    for before, after in pairwise(measured[:40]):
        v_hat, theta_hat, _ = rk4_step(law, state.v_hat, state.theta_hat, before, after)
        following = law.step(state, before, after)
        np.testing.assert_allclose(following.v_hat, v_hat, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            following.theta_hat / scale, theta_hat / scale, rtol=1e-12, atol=1e-12
        )
        moved = max(moved, np.abs((following.theta_hat - state.theta_hat) / scale).max())
        state = following
    assert moved > 1e-6  # else there was nothing to compare


def test_no_step_returns_an_estimate_outside_the_cone():
    """A law far too fast for dt ends with a status and the last good estimate, never in NaN."""
    cone, measured = (
        geometry.Cone.of(scenario_plant("bluerov2").system.space),
        driven("bluerov2", 5.0, seed=MOTION).rows[:20],
    )
    endings = set()
    for seed in range(8):
        gain = 10.0 ** (3 + seed)
        law = build("bluerov2", inside("bluerov2", seed), gain=gain, mu=1 / gain)
        state = law.init(measured[0])
        for before, after in pairwise(measured):
            state = law.step(state, before, after)
            assert cone.contains(state.theta_hat) and np.isfinite(state.theta_hat).all()
            assert np.isfinite(state.v_hat).all()
            if state.status is not Status.completed:
                break
        endings.add(state.status)
    assert endings & {Status.estimate_not_positive_definite, Status.adaptation_too_fast}


def test_a_tied_mass_matrix_is_held_inside_by_a_law_too_fast_for_it():
    """Steps as long as the cone is wide are divided, also where a tied matrix cuts them."""
    measured, system = driven("remus100", 5.0, seed=MOTION).rows, scenario_plant("remus100").system
    cone, place = geometry.Cone.of(system.space), system.space["mass matrix"]
    long = 0
    for seed in range(2):
        law = build("remus100", inside("remus100", seed, 1.0), gain=700.0, mu=1e-4)
        state = law.init(measured[0])
        for before, after in pairwise(measured[:100]):
            following = law.step(state, before, after)
            if following.status is not Status.completed:
                break
            assert cone.contains(following.theta_hat)
            change = law.conserved(following.theta_hat) - law.conserved(state.theta_hat)
            assert abs(change) <= 64 * ACCURACY * law.metric.mu * cone.degree * (1 + 1e-6)
            whole = np.r_[state.theta_hat[place], np.ones(system.p - 6)]
            metric = cone.derivatives(whole)[1][place, place]
            d = (following.theta_hat - state.theta_hat)[place]
            long += np.sqrt(d @ metric @ d) > 0.5
            state = following
    assert long > 0


def test_without_a_barrier_the_cone_law_is_the_papers_law():
    p = scenario_plant("bluerov2")
    config = NullspaceAID(K=6.0, gain=0.6, law="cone", barrier=0.0)
    law = config.build(p.system, p.truth, p.dt)
    assert type(law) is NullspaceIdentifier and not config.in_cone


def test_a_start_outside_the_cone_is_refused():
    p = scenario_plant("bluerov2")
    prior = p.truth.copy()
    prior[0] = -1.0
    with pytest.raises(InvalidInput, match="cone"):
        build("bluerov2", prior)
    with pytest.raises(InvalidInput, match="mu"):
        build("bluerov2", p.truth, mu=0.0)
