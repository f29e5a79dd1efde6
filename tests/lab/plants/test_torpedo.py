"""REMUS 100: MuJoCo and the structure agree with the published equations (z down)."""

from functools import partial

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.lab.control.autopilot import DepthHeadingAutopilot
from nsaid_mj.lab.control.signals import Multisine
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.robots.assets import published_numbers
from tests.support.plants import drive, hold, plant, wrong_prior
from tests.support.vehicles import acceleration

DOWN = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""Turns twists and wrenches x forward, y left, z up into x forward, y right, z down, and back."""

START = np.array([0.5, -1.0, -20.0, 0.15, -0.2, 0.4]), np.array([1.8, 0.15, -0.1, -0.6, 0.1, -0.15])
COMMAND = np.array([0.12, 0.05, -0.1, 0.04, 0.8])
remus = partial(plant, "remus100", dt=0.01)


def cruise(p, seconds, seed=0, **options):
    """Measurements under the autopilot, with a prior 30 % off."""
    config = DepthHeadingAutopilot(**options)
    driver = config.build(p.system, wrong_prior(p, seed), np.random.default_rng(seed))
    return drive(p, driver, seconds).rows


# -- MuJoCo is the structure ---------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_w_theta_is_zero_along_mujocos_motion(seed):
    p = remus(seed)
    system, theta = p.system, p.truth
    for t, q, v, u in cruise(p, 20, seed)[::50]:
        place = np.r_[q[:3], pin.log3(pin.Quaternion(q[3:]).toRotationMatrix())]
        a = acceleration(p, place, v, u)
        W = system.regressor(t, np.r_[q, v], v, a, u)
        force = np.abs(system.F(t, np.r_[q, v], u) * theta).max()
        assert np.abs(W @ theta).max() <= 1e-10 * force


def test_m_is_positive_definite_and_c_is_skew():
    system, theta, rng = remus().system, remus().truth, np.random.default_rng(0)
    q, v, _ = system.random_state(rng)
    M = system.mass_matrix(np.r_[q, v], theta)
    C = system.coriolis_matrix(np.r_[q, v], theta)
    assert np.linalg.eigvalsh(M)[0] > 0 and (M == M.T).all()
    assert np.abs(C + C.T).max() <= 1e-13 * np.abs(C).max()  # M is constant in the body's axes


# -- the truth is the published vehicle ----------------------------------------------------------


def bilinear(i, j, remove):
    """∂²(force)_i/∂u∂ν_j in the prints' axes, without the rigid body's `remove`, fins at rest."""
    p = remus(spread=0.0)
    system, x = p.system, p.system.position(np.zeros(6))
    u, force = np.zeros(5), {}
    for ahead in (1.5, 2.5):
        for sign in (-1, 1):
            v = np.zeros(6)
            v[0], v[j] = ahead, sign * 0.1
            state = np.r_[x, v]
            force[ahead, sign] = (system.F(0.0, state, u) - system.W_C(state, v)) @ p.truth
    slope = {ahead: (force[ahead, 1] - force[ahead, -1])[i] / 0.2 for ahead in (1.5, 2.5)}
    return DOWN[i] * DOWN[j] * (slope[2.5] - slope[1.5]) - remove


@pytest.mark.parametrize(
    "name,i,j,printed,rigid",
    [
        ("Y_uv", 1, 1, -28.6, 0),
        ("Y_ur", 1, 5, 5.22, -30.48),
        ("Z_uw", 2, 2, -28.6, 0),
        ("Z_uq", 2, 4, -5.22, 30.48),
        ("M_uw", 4, 2, 24.0, 0),
        ("M_uq", 4, 4, -2.0, 0),
        ("N_uv", 5, 1, -24.0, 0),
        ("N_ur", 5, 5, -2.0, 0),
    ],
)
def test_body_and_fins_together_have_the_published_coefficients(name, i, j, printed, rigid):
    """Two of the eight went in; the others follow from fins, added mass and body lift."""
    assert bilinear(i, j, rigid) == pytest.approx(printed, abs=0.011), name


def test_full_thrust_reaches_the_published_speed():
    """2.5 m/s at 1525 rpm, Allen et al. (2000); K_T and drag are theirs, the speed is not used."""
    p = remus(spread=0.0)
    place, v = np.zeros(6), np.zeros(6)
    v[0] = 2.0
    end = hold(p, (place, v), np.array([0, 0, 0, 0, 1.0]), 20)
    assert np.linalg.norm(end[6:9]) == pytest.approx(2.5, rel=0.06)


def test_hidden_numbers_differ_by_seed_and_do_not_enter_the_scale():
    one, other, nominal = remus(1), remus(2), remus(1, spread=0.0)
    assert (one.system.space.scale == other.system.space.scale).all()
    assert (np.log2(one.system.space.scale) % 1 == 0).all()
    ratio = one.truth / nominal.truth
    assert (ratio[:6] == 1).all()  # inertias are the published ones
    assert (np.abs(ratio - 1) <= 0.2).all() and len(set(ratio[6:])) == len(ratio[6:])
    assert (one.truth[6:] != other.truth[6:]).all()


# -- the signs -----------------------------------------------------------------------------------


def test_drag_and_fins_at_rest_brake_every_motion():
    system, rng = remus().system, np.random.default_rng(5)
    drag, fins = system.space["quadratic drag"], system.space["fin lift"]
    for _ in range(100):
        q, v, _ = system.random_state(rng)
        F = system.F(0.0, np.r_[q, v], np.zeros(5))
        power = v @ F
        assert (power[drag] < 0).all() and (power[fins] <= 0).all()


def test_positive_fin_deflections_turn_the_vehicle_as_documented():
    """The rudders' lift to the left, astern, turns the nose right; the planes' upwards, down."""
    p = remus(spread=0.0)
    start = np.zeros(6), np.r_[2.0, np.zeros(5)]
    rudders, planes = (
        hold(p, start, np.array(u), 1) - hold(p, start, np.zeros(5), 1)
        for u in ([0.1, 0.1, 0, 0, 0.0], [0, 0, 0.1, 0.1, 0.0])
    )
    assert rudders[11] < -0.02 and planes[10] > 0.02
    apart = hold(p, start, np.array([0.1, -0.1, 0, 0, 0.0]), 0.3)
    assert apart[9] < -0.1  # upper rudder to the left, lower to the right


def test_the_torpedo_rights_itself_and_floats():
    p = remus(spread=0.0)
    heeled = np.array([0, 0, 0, 0.3, 0, 0.0])
    after = hold(p, (heeled, np.zeros(6)), np.zeros(5), 0.1)
    assert after[9] < 0 and after[8] > 0  # rolls back, rises


# -- against the prints' equations, written out --------------------------------------------------


def prestero(truth, names, u_fins, n):
    """d/dt of (x, y, z, φ, θ, ψ, u, v, w, p, q, r), z down: Prestero (2001), eq. (4.1) on.

    Scalars as printed, with each fin's own force. Nothing of the package is used.
    """
    d = published_numbers("remus100")
    k = dict(zip(names, truth, strict=True))
    m, zg = d["mass"], d["gravity_centre"][2]
    Ixx, Iyy, Izz = d["inertia"]
    a = d["added_mass"]
    Xud, Yvd, Kpd, Mqd, Yrd = (a[s] for s in ("X_udot", "Y_vdot", "K_pdot", "M_qdot", "Y_rdot"))
    Zwd, Nrd, Nvd, Zqd, Mwd = Yvd, Mqd, Yrd, -Yrd, -Yrd
    xf, rf = d["fins"]["N_uudr"] / d["fins"]["Y_uudr"], d["fins"]["radius"]
    WB, restoring = k["net weight"], k["righting_z"]
    slip = 0.944 * (0.4566 - 0.1798) / 0.6632 / (0.14 * 25.4167) / 0.4566
    fin_rows = [k[f"fin lift_{i}"] for i in range(1, 5)], [k[f"fin drag_{i}"] for i in range(1, 5)]
    A = np.array(
        [
            [m - Xud, 0, 0, 0, m * zg, 0],
            [0, m - Yvd, 0, -m * zg, 0, -Yrd],
            [0, 0, m - Zwd, 0, -Zqd, 0],
            [0, -m * zg, 0, Ixx - Kpd, 0, 0],
            [m * zg, 0, -Mwd, 0, Iyy - Mqd, 0],
            [0, -Nvd, 0, 0, 0, Izz - Nrd],
        ]
    )

    def rate(_, s):
        phi, th, psi, u, v, w, p, q, r = s[3:]
        X = (
            -WB * np.sin(th)
            - k["dq_along"] * u * abs(u)
            + (Zwd - m) * w * q
            + Zqd * q * q
            + (m - Yvd) * v * r
            - Yrd * r * r
            - m * zg * p * r
            + k["thrust"] * abs(n) * (n - slip * u)
        )
        Y = (
            WB * np.cos(th) * np.sin(phi)
            - k["dq_across"] * v * abs(v)
            - k["lift_body"] * u * v
            + (m - Zwd) * w * p
            + (Xud - m) * u * r
            - Zqd * p * q
            - m * zg * q * r
        )
        Z = (
            WB * np.cos(th) * np.cos(phi)
            - k["dq_across"] * w * abs(w)
            - k["lift_body"] * u * w
            + (m - Xud) * u * q
            + (Yvd - m) * v * p
            + Yrd * r * p
            + m * zg * (p * p + q * q)
        )
        K = (
            -restoring * np.cos(th) * np.sin(phi)
            - k["dq_roll"] * p * abs(p)
            - (Izz - Iyy) * q * r
            + m * zg * (u * r - w * p)
            - k["torque"] * n * abs(n)
        )
        M = (
            -restoring * np.sin(th)
            - k["dq_turn"] * q * abs(q)
            - k["lift moment_body"] * u * w
            - (Zwd - Xud) * u * w
            - Yrd * v * p
            + (Kpd - Nrd - Ixx + Izz) * r * p
            - Zqd * u * q
            + m * zg * (v * r - w * q)
        )
        N = (
            -k["dq_turn"] * r * abs(r)
            + k["lift moment_body"] * u * v
            - (Xud - Yvd) * u * v
            + Zqd * w * p
            - (Kpd - Mqd + Iyy - Ixx) * p * q
            + Yrd * u * r
        )
        for j, (z, delta) in enumerate(((-rf, u_fins[0]), (rf, u_fins[1]))):  # rudders
            side = -fin_rows[0][j] * (u * u * delta + u * (v + xf * r - z * p))
            brake = -fin_rows[1][j] * u * u * delta**2
            X, Y, K, M, N = X + brake, Y + side, K - z * side, M + z * brake, N + xf * side
        for j, (y, delta) in enumerate(((-rf, u_fins[2]), (rf, u_fins[3]))):  # planes, left first
            side = -fin_rows[0][2 + j] * (u * u * delta + u * (w - xf * q + y * p))
            brake = -fin_rows[1][2 + j] * u * u * delta**2
            X, Z, K, M, N = X + brake, Z + side, K + y * side, M - xf * side, N - y * brake
        c, s_, t = np.cos, np.sin, np.tan
        place = [
            c(psi) * c(th) * u
            + (c(psi) * s_(th) * s_(phi) - s_(psi) * c(phi)) * v
            + (s_(psi) * s_(phi) + c(psi) * c(phi) * s_(th)) * w,
            s_(psi) * c(th) * u
            + (c(phi) * c(psi) + s_(phi) * s_(th) * s_(psi)) * v
            + (s_(th) * s_(psi) * c(phi) - c(psi) * s_(phi)) * w,
            -s_(th) * u + c(th) * s_(phi) * v + c(th) * c(phi) * w,
        ]
        turn = [
            p + s_(phi) * t(th) * q + c(phi) * t(th) * r,
            c(phi) * q - s_(phi) * r,
            (s_(phi) * q + c(phi) * r) / c(th),
        ]
        return np.r_[place, turn, np.linalg.solve(A, [X, Y, Z, K, M, N])]

    return rate


def textbook(p, seconds):
    """(3,) place, (3, 3) attitude and (6,) twist, z up, of the prints' equations."""
    angles = np.array([0.15, 0.2, -0.4])  # roll, pitch, yaw, z down
    R = pin.rpy.rpyToMatrix(angles)
    turn = DOWN[3:]
    start = np.r_[DOWN[:3] * START[0][:3], angles, DOWN * START[1]]
    rate = prestero(p.truth, p.system.space.names, COMMAND[:4], COMMAND[4])
    end = solve_ivp(rate, (0, seconds), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    first = turn[:, None] * R * turn
    last = turn[:, None] * pin.rpy.rpyToMatrix(end[3:6]) * turn
    return pin.log3(first), (DOWN[:3] * end[:3], last, DOWN * end[6:])


def distance(p, seconds):
    """Largest difference of MuJoCo's pose and twist to the prints' equations'."""
    vector, (place, attitude, twist) = textbook(p, seconds)
    end = hold(p, (np.r_[START[0][:3], vector], START[1]), COMMAND, seconds)
    apart = pin.log3(attitude.T @ pin.exp3(end[3:6]))
    return np.abs(np.r_[end[:3] - place, apart, end[6:] - twist]).max()


@pytest.mark.parametrize("seed", range(2))
def test_mujoco_moves_as_the_published_equations_integrated_by_scipy(seed):
    assert distance(remus(seed, dt=0.001), 4.0) <= 1e-8


def test_the_error_of_mujocos_steps_is_of_fourth_order():
    """Before any velocity passes 0, where |v| v has a kink."""
    steps = np.array([0.04, 0.02, 0.01])
    errors = np.array([distance(remus(1, dt=float(dt)), 0.2) for dt in steps])
    assert errors[-1] > 1e-13
    assert 3.6 < np.polyfit(np.log(steps), np.log(errors), 1)[0] < 4.6, errors


# -- mismatch ------------------------------------------------------------------------------------

STILL = {"lag": 0.1, "delay": 0.1, "flow": (0.2, -0.3, 0.1), "fluid": "ellipsoid"}


@pytest.mark.parametrize("field,value", STILL.items())
def test_each_mismatch_changes_the_motion_and_is_reported(field, value):
    off = remus(mismatch=Mismatch(**{field: value}))
    assert off.mismatches and not remus().mismatches
    difference = hold(off, START, COMMAND, 3.0) - hold(remus(), START, COMMAND, 3.0)
    assert np.abs(difference).max() > 1e-3 and np.isfinite(difference).all()


@pytest.mark.parametrize("fluid", ["exact", "ellipsoid"])
def test_motion_in_steady_flow_is_that_in_still_water_carried_along(fluid):
    flow = np.array([0.3, -0.2, 0.1])
    still = remus(dt=0.002, mismatch=Mismatch(fluid=fluid))
    carried = remus(dt=0.002, mismatch=Mismatch(fluid=fluid, flow=tuple(flow)))
    place, v = START
    faster = v.copy()
    faster[:3] += pin.exp3(place[3:]).T @ flow
    one, two = hold(still, START, COMMAND, 3.0), hold(carried, (place, faster), COMMAND, 3.0)
    assert np.abs(two[3:6] - one[3:6]).max() < 1e-8
    assert np.abs(two[:3] - one[:3] - 3.0 * flow).max() < 1e-8
    assert np.abs(two[9:] - one[9:]).max() < 1e-8


def test_lag_acts_on_the_fins_deflection_not_on_its_force():
    """The actuators' activation is what the fins do: it ends at the command."""
    p = remus(mismatch=Mismatch(lag=0.1))
    hold(p, START, COMMAND, 2.0)
    np.testing.assert_allclose(p.data.act, COMMAND, rtol=1e-6)
    with p.running():
        p.reset(*START)
        p.data.ctrl[:], p.data.act[:] = 0.0, COMMAND
        mujoco.mj_forward(p.model, p.data)
        lagged = p.data.qacc.copy()
    exact = remus()
    with exact.running():
        exact.reset(*START)
        exact.data.ctrl[:] = COMMAND
        mujoco.mj_forward(exact.model, exact.data)
        np.testing.assert_allclose(lagged, exact.data.qacc, rtol=1e-12, atol=1e-12)


# -- the autopilot -------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_the_autopilot_keeps_speed_and_attitude_within_the_fins_range(seed):
    seen = cruise(remus(seed, dt=0.02), 120, seed)
    q, v, u = (np.array([row[i] for row in seen]) for i in (1, 2, 3))
    assert v[0, 0] > 1 and (v[0, 1:] == 0).all()  # it starts under way
    assert (v[:, 0] > 0.5).all() and (v[:, 0] < 3.5).all()
    assert np.abs(q[:, 2] + 20).max() < 15
    upright = np.array([pin.Quaternion(row[3:]).toRotationMatrix()[2, 2] for row in q])
    assert (upright > 0.3).all()
    limit = published_numbers("remus100")["fins"]["limit"]
    assert (np.abs(u[:, :4]) <= limit).all() and (np.abs(u[:, :4]).max(axis=0) == limit).all()
    assert (u[:, 4] >= 0.2).all() and (u[:, 4] <= 1).all()


def test_without_dither_depth_and_heading_follow_their_references():
    p = remus(0, dt=0.02)
    calm = DepthHeadingAutopilot(dither=1e-9, swing=1e-9, slow=400.0)
    driver = calm.build(p.system, wrong_prior(p, 3), np.random.default_rng(3))
    rng = np.random.default_rng(3)
    Multisine(p.system.n_u, calm.low, calm.high, calm.tones, 1.0, rng)  # is drawn first
    course = Multisine(2, calm.low / calm.slow, calm.high / calm.slow, calm.tones, 1.0, rng)
    depth, heading = [], []
    with p.running():
        for t, q, _, _ in p.trajectory(driver, 15000).rows:
            dive, turn = course(t)
            if t > 60:
                depth.append(q[2] + 20 - 5 * dive)
                R = pin.Quaternion(q[3:]).toRotationMatrix()
                heading.append(np.arctan2(R[1, 0], R[0, 0]) - 1.5 * turn)
    assert np.std(depth) < 1.0 and np.std(heading) < 0.2


def test_the_autopilot_uses_only_the_prior():
    """With another plant and the same prior it gives the same command."""
    one, other = remus(1), remus(2)
    prior = wrong_prior(one, 0)
    commands = []
    for p in (one, other):
        driver = DepthHeadingAutopilot().build(p.system, prior, np.random.default_rng(0))
        q = p.system.position(START[0])
        commands.append([*driver.start(), *(driver.command(t, q, START[1]) for t in (0.0, 3.0))])
    for a, b in zip(*commands, strict=True):
        assert (a == b).all()


def test_the_autopilot_refuses_other_vehicles():
    rov = BlueROV2Plant().build(0.01, 0)
    with pytest.raises(InvalidInput) as caught:
        DepthHeadingAutopilot().build(rov.system, rov.truth, np.random.default_rng(0))
    assert caught.value.name == "excitation" and "torpedo" in caught.value.expected


def test_the_mounts_are_where_the_forces_act():
    system = remus().system
    mounts = system.mounts
    assert mounts is not None and mounts.shape == (len(system.space.actuators), 3)
    named = [system.space.names[i] for i in system.space.actuators]
    unseen = np.isnan(mounts[:, 0])
    assert [named[i] for i in np.flatnonzero(unseen)] == ["torque"]
    q, v, u = system.random_state(np.random.default_rng(0))
    F = system.F(0.0, np.r_[q, v], u)[:, system.space.actuators[~unseen]]
    moment = np.cross(mounts[~unseen], F[:3].T)
    np.testing.assert_allclose(moment, F[3:].T, atol=1e-12)


# -- in reverse ----------------------------------------------------------------------------------


def forces_of(p, v, u):
    """(n, p) F at the origin, upright."""
    return p.system.F(0.0, np.r_[p.system.position(np.zeros(6)), v], u)


@pytest.mark.parametrize("n", [0.3, 0.8, 1.0])
def test_the_propeller_turned_backwards_pulls_and_twists_the_other_way(n):
    """At rest thrust and torque are odd in the shaft's speed, in the structure and in MuJoCo."""
    p, still = remus(1), np.zeros(6)
    ahead, astern = (np.array([0, 0, 0, 0, sign * n]) for sign in (1, -1))
    place = p.system.space["propeller gain"]
    there, back = (forces_of(p, still, u)[:, place] for u in (ahead, astern))
    assert there[0, 0] == pytest.approx(n**2) and there[3, 1] == pytest.approx(-(n**2))
    assert (back == -there).all()
    a, b, idle = (acceleration(p, still, still, u) for u in (ahead, astern, np.zeros(5)))
    assert a[0] > idle[0] > b[0] and a[3] < idle[3] < b[3]
    assert b - idle == pytest.approx(idle - a, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("speed", [1.5, -1.5])
def test_a_deflected_fins_drag_brakes_ahead_and_astern(speed):
    """Its lift is odd in the deflection and its drag even, in the structure and in MuJoCo."""
    p, v = remus(1), np.r_[speed, np.zeros(5)]
    u = np.array([0.1, -0.05, 0.08, 0.12, 0.0])
    drag, lift = p.system.space["fin drag"], p.system.space["fin lift"]
    one, other, rest = (forces_of(p, v, s * u) for s in (1, -1, 0))
    power = v @ one[:, drag]
    assert power == pytest.approx(-(abs(speed) ** 3) * u[:4] ** 2, rel=1e-12)
    assert (one[:, drag] == other[:, drag]).all() and (one[:, lift] == -other[:, lift]).all()
    assert not rest[:, drag].any()
    sideways = np.diag(one[[1, 1, 2, 2], lift])  # rudders push to y, planes to z
    assert sideways == pytest.approx(abs(speed) * speed * u[:4], rel=1e-12)
    a, b, none = (acceleration(p, np.zeros(6), v, s * u) for s in (1, -1, 0))
    M = p.system.mass_matrix(np.r_[p.system.position(np.zeros(6)), v], p.truth)
    pushed, braking = M @ (0.5 * (a - b)), M @ (0.5 * (a + b) - none)
    assert pushed == pytest.approx(one[:, lift] @ p.truth[lift], rel=1e-9, abs=1e-9)
    expected = -abs(speed) * speed * (u[:4] ** 2 @ p.truth[drag])
    assert braking[0] == pytest.approx(expected, rel=1e-9) and braking[0] * speed < 0
