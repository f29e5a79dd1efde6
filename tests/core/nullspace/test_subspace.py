"""P_s(θ): an orthogonal split, one rank decision, and unobservable directions in words."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=40)
dims = st.tuples(st.integers(1, 8), st.integers(0, 8)).filter(lambda d: d[1] <= d[0])
PLANTS = {
    "scalar": ScalarRovPlant(),
    "double_pendulum": ArmPlant(robot="double_pendulum"),
    "finger_edu": ArmPlant(robot="finger_edu"),
    "kinova": ArmPlant(robot="kinova"),
}
plants = pytest.mark.parametrize("name", PLANTS)


@cache
def built(name: str):
    """(system, truth, P_s of the truth)."""
    plant = PLANTS[name].build(1e-4, 3)
    nullspace = Nullspace.structural(plant.system, plant.truth, np.random.default_rng(0))
    return plant.system, plant.truth, nullspace


def stack(rng, p: int, r: int, rows: int = 30):
    """Rows that see all of R^p but r directions, and an orthonormal basis of these."""
    Q = np.linalg.qr(rng.standard_normal((p, p)))[0]
    return rng.standard_normal((rows, p - r)) @ Q[:, r:].T, Q[:, :r]


def projector(basis):
    return basis @ basis.T


# -- the split -------------------------------------------------------------------------------


@FEW
@given(seeds, dims)
def test_split_finds_a_planted_nullspace(seed, pr):
    rows, planted = stack(np.random.default_rng(seed), *pr)
    found = Nullspace.of(rows)
    assert found.r == pr[1]
    np.testing.assert_allclose(projector(found.P), projector(planted), atol=1e-9)
    counts, not_ = found.gap
    assert not_ < Nullspace.TOLERANCE and (counts > Nullspace.TOLERANCE or pr[0] == pr[1])


@FEW
@given(seeds, dims)
def test_the_split_is_orthogonal_and_complete(seed, pr):
    rng = np.random.default_rng(seed)
    rows, _ = stack(rng, *pr)
    found = Nullspace.of(rows)
    np.testing.assert_allclose(found.Q.T @ found.Q, np.eye(pr[0]), atol=1e-12)  # (36)
    theta = rng.standard_normal((4, pr[0]))
    inside, outside = found.coordinates(theta)  # (40)
    np.testing.assert_allclose(inside @ found.P.T + outside @ found.P_perp.T, theta, atol=1e-12)
    np.testing.assert_allclose(rows @ found.P, 0, atol=1e-9 * np.abs(rows).max(initial=1))


@FEW
@given(seeds, dims)
def test_scaling_repeating_or_reordering_rows_changes_nothing(seed, pr):
    rng = np.random.default_rng(seed)
    rows, _ = stack(rng, *pr)
    factors = np.where(np.arange(len(rows)) > 0, 1e-12, 1.0)  # one row louder than all others
    other = np.vstack([rows * factors[:, None], -rows[:3], np.zeros((3, pr[0]))])
    other[-6:-3] *= 1e12
    one, two = Nullspace.of(rows), Nullspace.of(other[rng.permutation(len(other))])
    assert one.r == two.r
    np.testing.assert_allclose(projector(one.P), projector(two.P), atol=1e-9)


@FEW
@given(seeds, st.integers(2, 8))
def test_fewer_rows_than_parameters_leave_the_rest_unseen(seed, p):
    rows = np.random.default_rng(seed).standard_normal((p - 1, p))
    found = Nullspace.of(rows)
    assert found.r == 1 and found.singular_values.shape == (p,)
    np.testing.assert_allclose(rows @ found.P, 0, atol=1e-9 * np.abs(rows).max())


@pytest.mark.parametrize("size,r", [(3e-8, 0), (3e-9, 1)])
def test_the_tolerance_decides_the_rank(size, r):
    """Two nearly parallel rows: the second singular value is half their distance."""
    found = Nullspace.of(np.array([[1.0, size], [1.0, -size]]))
    assert found.r == r
    assert found.singular_values[1] == pytest.approx(size, rel=1e-6)


def test_a_zero_regressor_leaves_the_whole_space_unobservable():
    found = Nullspace.of(np.zeros((5, 3)))
    assert found.r == 3 and found.P_perp.shape == (3, 0) and found.gap == (0.0, 0.0)


@pytest.mark.parametrize(
    "rows", [np.zeros((0, 3)), np.ones(3), np.array([[1.0, np.nan]]), np.array([[np.inf, 1.0]])]
)
def test_a_stack_without_finite_rows_is_refused(rows):
    with pytest.raises(InvalidInput) as caught:
        Nullspace.of(rows)
    assert caught.value.name == "stack"


@FEW
@given(seeds, st.floats(0, np.pi / 2), st.floats(1e-6, 1e6))
def test_the_ratio_is_the_sine_of_the_angle_to_P(seed, angle, length):
    rows, _ = stack(np.random.default_rng(seed), 5, 2)
    found = Nullspace.of(rows)
    theta = length * (np.cos(angle) * found.P[:, 0] + np.sin(angle) * found.P_perp[:, 1])
    assert found.ratio(theta) == pytest.approx(np.sin(angle), abs=1e-9)
    assert found.ratio(-2 * theta) == pytest.approx(np.sin(angle), abs=1e-9)


def test_the_ratio_of_a_batch_is_that_of_each_sample():
    rows, _ = stack(np.random.default_rng(0), 5, 2)
    found, theta = Nullspace.of(rows), np.random.default_rng(1).standard_normal((3, 4, 5))
    assert found.ratio(theta).shape == (3, 4)
    np.testing.assert_allclose(found.ratio(theta)[2, 1], found.ratio(theta[2, 1]), rtol=1e-14)


# -- P_s of a system -------------------------------------------------------------------------


@plants
def test_the_truth_lies_in_its_own_nullspace(name):
    system, truth, found = built(name)
    assert found.ratio(truth / system.space.scale) < 1e-12  # W(t, x, v̂, θ) θ = 0 (30)


@pytest.mark.parametrize("name,r", [("scalar", 1), ("kinova", 27)])
def test_the_nullspace_has_its_known_dimension(name, r):
    assert built(name)[2].r == r


def test_the_ur5_has_57_observable_directions():
    plant = ArmPlant(robot="ur5").build(1e-3, 1)
    found = Nullspace.structural(plant.system, plant.truth, np.random.default_rng(1))
    assert found.P_perp.shape == (84, 57)


@plants
def test_other_states_give_the_same_nullspace(name):
    system, truth, found = built(name)
    again = Nullspace.structural(system, truth, np.random.default_rng(99))
    np.testing.assert_allclose(projector(again.P), projector(found.P), atol=1e-7)


@plants
def test_parameters_in_P_leave_the_motion_unchanged_and_others_change_it(name):
    system, truth, found = built(name)
    rng = np.random.default_rng(5)
    q, v, u = (
        np.array(part) for part in zip(*(system.random_state(rng) for _ in range(5)), strict=True)
    )
    x, scale = np.hstack([q, v]), system.space.scale
    a = system.acceleration(0.0, x, v, u, truth)
    size = 1e-3 * np.linalg.norm(truth / scale)
    for basis, seen in ((found.P, False), (found.P_perp, True)):
        direction = basis @ rng.standard_normal(basis.shape[1])
        moved = truth + size * scale * direction / np.linalg.norm(direction)
        change = np.abs(system.acceleration(0.0, x, v, u, moved) - a).max() / np.abs(a).max()
        assert change > 1e-6 if seen else change < 1e-8


@plants
def test_a_member_of_P_has_the_same_nullspace(name):
    system, truth, found = built(name)
    step = found.P @ np.random.default_rng(6).standard_normal(found.r)
    member = truth + 1e-3 * np.linalg.norm(truth / system.space.scale) * system.space.scale * step
    other = Nullspace.structural(system, member, np.random.default_rng(7))
    assert other.r == found.r
    np.testing.assert_allclose(projector(other.P), projector(found.P), atol=1e-6)


# -- directions in words -----------------------------------------------------------------------


@plants
def test_as_many_directions_are_described_as_P_has(name):
    system, _, found = built(name)
    assert len(found.directions(system.space)) == found.r


@plants
def test_described_directions_lie_in_P_and_are_independent(name):
    system, _, found = built(name)
    trades = [d for d in found.directions(system.space) if d.weights]
    vectors = np.zeros((len(trades), system.p))
    for vector, d in zip(vectors, trades, strict=True):
        vector[[system.space.index(parameter) for parameter in d.parameters]] = d.weights
        lead = system.space.labels[system.space.index(d.parameters[0])]
        assert d.weights[0] == 1 and lead in d.words and lead in d.fix
        assert found.ratio(vector) < 1e-5
    assert np.linalg.matrix_rank(vectors, tol=1e-6) == len(trades)


@plants
def test_a_direction_is_described_by_few_parameters(name):
    system, _, found = built(name)
    assert all(len(d.parameters) <= 8 for d in found.directions(system.space) if d.weights)


@plants
def test_a_common_scale_moves_its_parameters_by_one_factor(name):
    system, truth, found = built(name)
    scales = [d for d in found.directions(system.space) if not d.weights]
    assert scales, "motors and plant always share a scale"
    for d in scales:
        places = [system.space.index(parameter) for parameter in d.parameters]
        factors = found.P[places] / (truth / system.space.scale)[places, None]
        assert np.abs(factors - factors[0]).max() < 1e-6 * np.linalg.norm(factors[0])
        assert "common scale" in d.words and d.fix
    named = {parameter for d in scales for parameter in d.parameters}
    assert named >= {system.space.names[i] for i in system.space.actuators}


def test_the_scalar_vehicle_is_known_up_to_one_scale():
    system, _, found = built("scalar")
    (only,) = found.directions(system.space)
    assert only.parameters == ("mass", "drag", "net weight", "thruster gain")


def test_a_parameter_without_effect_is_described_alone():
    system, _, _ = built("scalar")
    seen = np.eye(4)[[0, 2, 3]]  # nothing sees the drag
    found = Nullspace.of(seen)
    (only,) = found.directions(system.space)
    assert only.parameters == ("drag",) and "does not affect" in only.words


def test_an_empty_nullspace_has_no_directions_to_describe():
    system, _, _ = built("scalar")
    everything = Nullspace(np.zeros((4, 0)), np.eye(4), np.ones(4), Nullspace.TOLERANCE)
    assert everything.directions(system.space) == []
