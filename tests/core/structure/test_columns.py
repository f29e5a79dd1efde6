"""Every kind of column against its formula in numpy, and where it pulls on a tree."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.columns import KINDS
from nsaid_mj.core.structure.forces import BODY_KINDS
from nsaid_mj.core.structure.parts import Body, Column, Inertia
from nsaid_mj.core.structure.structure import Structure
from nsaid_mj.lab.plants.conversion import odd
from tests.support.evaluation import Evaluation
from tests.support.matrices import assert_near
from tests.support.trees import random_bodies, random_column, random_motion

P, D, E6 = np.array([0.3, -0.2, 0.5]), np.array([0.6, 0.0, -0.8]), np.arange(1.0, 7.0)
X, Z, NONE = np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.zeros(3)
BENT = Column.interpolated(np.array([-1.0, 0.0, 2.0]), np.array([-3.0, 0.5, 4.5]))
STRIPS = np.array([[0.1, 0.2, 0.3, 0.5], [-0.4, 0.1, 0.2, 0.7]])
GRAVITY = np.array([0.4, -1.0, -9.0])


def force(f: Array, at: Array = NONE) -> Array:
    """(6,) wrench of a force at a point."""
    return np.r_[f, np.cross(at, f)]


def torque(n: Array) -> Array:
    return np.r_[NONE, n]


def strip_wrench(v: Array, w: Array) -> Array:
    total = np.zeros(6)
    for x, y, z, length in STRIPS:
        across = np.cross(D, np.cross(v + np.cross(w, [x, y, z]), D))
        push = -length * np.linalg.norm(across) * across
        total += force(push, np.array([x, y, z]))
    return total


def slip(v: Array, w: Array, u: float) -> float:
    return float(np.arctan2(v[1] + 0.4 * w[2], v[0]) - u)


def flow(v: Array, w: Array) -> Array:
    """Velocity of the point P."""
    return v + np.cross(w, P)


def flat(v: Array, w: Array) -> Array:
    return flow(v, w) - D @ flow(v, w) * D


WRENCHES = {
    "weight": ({"point": P}, lambda v, w, u, up, g: force(-up, P)),
    "buoyancy": ({"point": P}, lambda v, w, u, up, g: force(up, P)),
    "righting": ({"axis": D}, lambda v, w, u, up, g: torque(np.cross(D, up))),
    "payload": ({"point": P}, lambda v, w, u, up, g: force(g, P)),
    "linear_drag": ({"axes": E6}, lambda v, w, u, up, g: -E6 * np.r_[v, w]),
    "drag": ({"axes": E6}, lambda v, w, u, up, g: -E6 * np.r_[v, w] * np.abs(np.r_[v, w])),
    "speed_drag": ({"axes": E6}, lambda v, w, u, up, g: -np.linalg.norm(v) * E6 * np.r_[v, w]),
    "strip_drag": ({"axis": D, "strips": STRIPS}, lambda v, w, u, up, g: strip_wrench(v, w)),
    "lift": ({}, lambda v, w, u, up, g: force(-abs(v[0]) * np.array([0, v[1], v[2]]))),
    "lift_moment": ({}, lambda v, w, u, up, g: torque(abs(v[0]) * np.array([0, -v[2], v[1]]))),
    "thruster": (
        {"point": P, "direction": D, "curve": odd(0.5, 2.0)},
        lambda v, w, u, up, g: force((0.5 * u + 2 * u**3) * D, P),
    ),
    "nozzle": ({"point": P, "direction": D}, lambda v, w, u, up, g: force(u * D, P)),
    "rotor": ({"point": P, "direction": D}, lambda v, w, u, up, g: force(u * abs(u) * D, P)),
    "rotor_torque": ({"direction": D}, lambda v, w, u, up, g: torque(u * abs(u) * D)),
    "rotor_inflow": (
        {"point": P, "direction": D},
        lambda v, w, u, up, g: force(flat(v, w) @ flat(v, w) * D, P),
    ),
    "rotor_drag": (
        {"point": P, "direction": D},
        lambda v, w, u, up, g: force(-abs(u) * flat(v, w), P),
    ),
    "rotor_damping": (
        {"point": P, "direction": D},
        lambda v, w, u, up, g: force(-abs(u) * (D @ flow(v, w)) * D, P),
    ),
    "propeller": (
        {"point": P, "direction": D, "slip": 0.3},
        lambda v, w, u, up, g: force(abs(u) * (u - 0.3 * D @ flow(v, w)) * D, P),
    ),
    "propeller_torque": ({"direction": D}, lambda v, w, u, up, g: torque(-abs(u) * u * D)),
    "fin": (
        {"point": P, "direction": D},
        lambda v, w, u, up, g: force(abs(v[0]) * (v[0] * u - D @ flow(v, w)) * D, P),
    ),
    "fin_drag": ({"point": P}, lambda v, w, u, up, g: force(-abs(v[0]) * v[0] * u**2 * X, P)),
    "tyre": (
        {"arm": 0.4},
        lambda v, w, u, up, g: (
            force(-slip(v, w, u) * np.array([-np.sin(u), np.cos(u), 0]), np.zeros(3))
            + torque(-0.4 * slip(v, w, u) * np.cos(u) * Z)
        ),
    ),
    "rolling": ({"speed": 0.7}, lambda v, w, u, up, g: force(-np.tanh(v[0] / 0.7) * X)),
    "drive": ({"point": P}, lambda v, w, u, up, g: force(u * X, P)),
    "drive_loss": ({}, lambda v, w, u, up, g: force(-u * v[0] * X)),
}
FORCES = {
    "viscous": ({}, lambda q, v, u: -v),
    "quadratic": ({}, lambda q, v, u: -v * abs(v)),
    "cubic": ({}, lambda q, v, u: -(v**3)),
    "coulomb": ({"speed": 0.4}, lambda q, v, u: -np.tanh(v / 0.4)),
    "stribeck": (
        {"speed": 0.4, "stribeck": 0.9},
        lambda q, v, u: -np.tanh(v / 0.4) * np.exp(-((v / 0.9) ** 2)),
    ),
    "offset": ({"force": -0.7}, lambda q, v, u: -0.7),
    "spring": ({"rest": 0.2}, lambda q, v, u: 0.2 - q),
    "motor": ({"curve": BENT}, lambda q, v, u: np.interp(u, [-1, 0, 2], [-3, 0.5, 4.5])),
    "servo": ({"limit": 0.9}, lambda q, v, u: np.clip(u - q, -0.9, 0.9)),
}
OF_SEVERAL_JOINTS = {"load", "shared_viscous", "shared_coulomb"}


def test_every_kind_has_a_formula_here():
    assert set(KINDS) == set(WRENCHES) | set(FORCES) | OF_SEVERAL_JOINTS
    assert len({kind.number for kind in KINDS.values()}) == len(KINDS)


@pytest.mark.parametrize("kind", WRENCHES)
@pytest.mark.parametrize("seed", range(4))
def test_a_wrench_on_a_body_is_its_formula(kind, seed):
    constants, formula = WRENCHES[kind]
    where = {"input": 0} if KINDS[kind].commanded or kind == "tyre" else {}
    column = Column(kind, 0, body=0, **where, **constants)
    structure = Structure([Body("free")], [], [column], 1, 1, (), GRAVITY)
    q, v, _, _, _ = random_motion(structure, rng := np.random.default_rng(seed))
    u = rng.uniform(-1, 1, 1)
    x, y, z, s = q[3:]
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * s), 2 * (x * z + y * s)],
            [2 * (x * y + z * s), 1 - 2 * (x * x + z * z), 2 * (y * z - x * s)],
            [2 * (x * z - y * s), 2 * (y * z + x * s), 1 - 2 * (x * x + y * y)],
        ]
    )
    expected = formula(v[:3], v[3:], u[0], R[2], R.T @ GRAVITY)
    assert np.abs(expected).max() > 0
    assert_near(Evaluation(structure).F(q, v, u)[:, 0], expected)


@pytest.mark.parametrize("kind", FORCES)
@pytest.mark.parametrize("joint", ["hinge", "slide", "circle"])
@pytest.mark.parametrize("seed", range(3))
def test_a_force_of_a_joint_is_its_formula(kind, joint, seed):
    constants, formula = FORCES[kind]
    where = {"input": 1} if KINDS[kind].commanded else {}
    column = Column(kind, 0, dof=1, **where, **constants)
    structure = Structure([Body("hinge"), Body(joint, 0)], [], [column], 1, 2)
    q, v, _, _, u = random_motion(structure, np.random.default_rng(seed))
    angle = np.arctan2(q[2], q[1]) if joint == "circle" else q[1]
    found = Evaluation(structure).F(q, v, u)[:, 0]
    expected = formula(angle, v[1], u[1])
    assert expected != 0
    assert_near(found, np.array([0.0, expected]))


@pytest.mark.parametrize("seed", range(3))
def test_a_shared_motor_brakes_both_of_its_joints(seed):
    """The power of friction of a motor that turns by v₁ − v₂ is that of both joints' columns."""
    rng = np.random.default_rng(seed)
    places = [(1, 2), (2, 1)]
    columns = [Column("shared_viscous", 0, dof=i, other=j) for i, j in places]
    columns += [
        Column("shared_coulomb", 1, dof=i, other=j, sign=-1.0, speed=0.4) for i, j in places
    ]
    structure = Structure([Body("hinge"), Body("hinge", 0), Body("slide", 1)], [], columns, 2, 0)
    q, v, _, _, u = random_motion(structure, rng)
    F = Evaluation(structure).F(q, v, u)
    slip = v[1] - v[2]
    assert_near(F[:, 0], np.array([0.0, -v[2], -v[1]]))
    assert v @ F[:, 1] == pytest.approx(-slip * np.tanh(slip / 0.4))
    assert F[0, 1] == 0 and F[1, 1] == pytest.approx(-np.tanh(slip / 0.4))


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_load_is_the_weight_that_the_joint_carries(joint):
    rng = np.random.default_rng(joint)
    bodies = random_bodies(rng, "held", 3)
    inertias = [Inertia(b, 10 * b) for b in range(3)]
    plain = Structure(bodies, inertias, [], 31, 0)
    bodies_with_dof = [b for b in range(3) if bodies[b].joint != "fixed"]
    dof = int(plain.starts[bodies_with_dof[min(joint, len(bodies_with_dof) - 1)], 1])
    nominal = rng.uniform(0.3, 1, (3, 4))
    theta = np.zeros(31)
    for b in range(3):
        theta[10 * b : 10 * b + 4] = nominal[b]
    listed = np.column_stack([np.arange(3), nominal])
    column = Column("load", 30, dof=dof, speed=0.4, bodies=listed)
    structure = Structure(bodies, inertias, [column], 31, 0)
    q, v, _, _, u = random_motion(structure, rng)
    weight = Evaluation(plain).F(q, 0 * v, u) @ theta
    expected = -np.tanh(v[dof] / 0.4) * abs(weight[dof])
    assert expected != 0
    assert_near(Evaluation(structure).F(q, v, u)[dof, 30], expected)


# -- where a wrench pulls --------------------------------------------------------------------------


def pose_of(structure: Structure, q: Array, body: int) -> tuple[Array, Array]:
    """Rotation and position of a body in the world, from the definition of its joints."""
    own, at = structure.bodies[body], int(structure.starts[body, 0])
    if own.joint == "free":
        x, y, z, s = q[3:7]
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.eye(3) + 2 * s * k + 2 * k @ k, q[:3]
    if own.joint == "planar":
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([q[0], q[1], 0.0])
    R, p = np.eye(3), np.zeros(3)
    if own.parent >= 0:
        R, p = pose_of(structure, q, own.parent)
    p, R, axis = p + R @ np.asarray(own.position), R @ np.asarray(own.rotation), own.axis
    k = np.cross(np.asarray(axis), np.eye(3)).T
    if own.joint in ("hinge", "circle"):
        c, s = (np.cos(q[at]), np.sin(q[at])) if own.joint == "hinge" else q[at : at + 2]
        R = R @ (np.eye(3) + s * k + (1 - c) * k @ k)
    elif own.joint == "slide":
        p = p + q[at] * R @ np.asarray(axis)
    return R, p


@pytest.mark.parametrize("base", ["held", "free", "planar"])
@pytest.mark.parametrize("seed", range(6))
def test_a_wrench_on_a_tree_does_work_on_the_body_it_acts_on(base, seed):
    """F's column is ∂(body twist)/∂v, from poses alone, times the wrench."""
    rng, h = np.random.default_rng(seed), 1e-6
    bodies = random_bodies(rng, base, 4)
    body = int(rng.integers(0, 4))
    column = random_column("thruster", 0, 4, rng, body=body, input=0)
    structure = Structure(bodies, [], [column], 1, 1)
    system = Evaluation(structure)
    q, v, _, _, _ = random_motion(structure, rng)
    u = np.array([0.8])
    d, p = np.asarray(column.constants["direction"]), np.asarray(column.constants["point"])
    share = np.interp(0.8, [0.3, 3.0], [0.4, 2.5])
    R, _ = pose_of(structure, q, body)
    wrench = share * force(d, p)
    expected = np.zeros(structure.n)
    for j, e in enumerate(h * np.eye(structure.n)):
        R1, p1 = pose_of(structure, system.integrate(q, e), body)
        R0, p0 = pose_of(structure, system.integrate(q, -e), body)
        S = R.T @ (R1 - R0) / (2 * h)
        twist = np.r_[R.T @ (p1 - p0) / (2 * h), S[2, 1], S[0, 2], S[1, 0]]
        expected[j] = twist @ wrench
    assert_near(system.F(q, v, u)[:, 0], expected, 1e-8)


# -- curves and constants --------------------------------------------------------------------------


def test_curves_continue_oddly_and_tables_end_flat():
    def follow(curve, u):
        column = Column("motor", 0, dof=0, input=0, curve=curve)
        structure = Structure([Body("hinge")], [], [column], 1, 1)
        return Evaluation(structure).F(np.zeros(1), np.zeros(1), np.array([u]))[0, 0]

    assert follow(Column.polynomial(1.0, 2.0, 3.0), -2.0) == pytest.approx(-(2 + 8 + 24))
    assert follow(odd(1.0, 2.0), 2.0) == pytest.approx(2 + 16)
    for u in (-5.0, -1.0, -0.3, 0.0, 1.7, 2.0, 9.0):
        assert follow(BENT, u) == pytest.approx(np.interp(u, [-1, 0, 2], [-3, 0.5, 4.5]))


@pytest.mark.parametrize(
    "wrong,error",
    [
        (Column("viscous", 0, dof=5), InvalidInput),
        (Column("viscous", 7, dof=0), InvalidInput),
        (Column("thruster", 0, body=3, input=0, point=P, direction=D), InvalidInput),
        (Column("thruster", 0, body=0, input=1, point=P, direction=D), InvalidInput),
        (Column("thruster", 0, body=0, input=0, point=P), InvalidInput),
        (Column("thruster", 0, body=0, input=0, point=P[:2], direction=D), InvalidInput),
        (Column("motor", 0, dof=0, input=0, curve=[3.0, 1.0]), InvalidInput),
        (Column("coulomb", 0, dof=0, speed=np.nan), InvalidInput),
        (Column("shared_viscous", 0, dof=0, other=1), InvalidInput),
        (Column("coulomb", 0, dof=0, sped=1.0), UnknownName),
        (Column("viscos", 0, dof=0), UnknownName),
    ],
)
def test_a_wrong_column_is_refused(wrong, error):
    with pytest.raises(error):
        Structure([Body("hinge")], [], [wrong], 7, 1)


@pytest.mark.parametrize(
    "bodies",
    [
        [Body("hinge"), Body("free", 0)],
        [Body("free"), Body("hinge", -1)],
        [Body("hinge", 0)],
        [Body("hinge", axis=(1, 1, 0))],
        [Body("hinge", rotation=np.ones((3, 3)))],
    ],
)
def test_a_wrong_tree_is_refused(bodies):
    with pytest.raises(InvalidInput):
        Structure(bodies, [], [], 1, 0)


def test_two_rigid_bodies_on_one_body_are_refused():
    with pytest.raises(InvalidInput):
        Structure([Body("hinge")], [Inertia(0, 0), Inertia(0, 10)], [], 20, 0)


def test_kinds_below_the_limit_are_of_joints():
    assert {k.name for k in KINDS.values() if k.number < BODY_KINDS} == {
        *FORCES,
        *OF_SEVERAL_JOINTS,
    }
