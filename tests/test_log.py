"""A log is checked when it is made, whatever it is made of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.log import Log, Measurement
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.setup import Setup

PARTS = "tqvu"
GOOD = {
    "t": 0.1 * np.arange(5),
    "q": np.arange(10.0).reshape(5, 2),
    "v": np.ones((5, 2)),
    "u": np.zeros((5, 1)),
}
FLOATS = [np.float16, np.float32, np.float64, np.longdouble, np.int8, np.int64, np.uint16]
FEW = settings(deadline=None, max_examples=200)

shapes = st.lists(st.integers(0, 6), max_size=3).map(tuple)
numbers = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.integers(),
    st.booleans(),
    st.none(),
    st.text(max_size=3),
    st.complex_numbers(max_magnitude=1e3),
)
nested = st.recursive(numbers, lambda inner: st.lists(inner, max_size=6), max_leaves=20)


def strided(array: np.ndarray, how: str) -> np.ndarray:
    """An array of equal numbers under other strides."""
    if how == "columns":
        return np.asfortranarray(array)
    if how == "every other":
        wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]), array.dtype)
        wide[..., ::2] = array
        return wide[..., ::2]
    if how == "backwards":
        return np.ascontiguousarray(array[::-1])[::-1]
    return array


@FEW
@given(
    st.sampled_from(FLOATS),
    st.sampled_from(["plain", "columns", "every other", "backwards"]),
    st.booleans(),
)
def test_any_float_type_any_stride_and_lists_make_the_same_log(kind, how, as_list):
    parts = {name: strided(GOOD[name].astype(kind), how) for name in "qvu"}
    if as_list:
        parts = {name: part.tolist() for name, part in parts.items()}
    log = Log(strided(GOOD["t"], how), **parts)
    for name in PARTS:
        part = getattr(log, name)
        assert part.dtype == np.float64 and part.flags.c_contiguous
        np.testing.assert_array_equal(part, GOOD[name])


def test_contiguous_double_arrays_are_not_copied():
    log = Log(**GOOD)
    assert all(np.shares_memory(getattr(log, name), GOOD[name]) for name in PARTS)


def test_a_one_coordinate_log_accepts_flat_arrays():
    log = Log(GOOD["t"], np.arange(5), [1, 2, 3, 4, 5], GOOD["u"][:, 0])
    assert (log.q.shape, log.v.shape, log.u.shape) == ((5, 1),) * 3


@pytest.mark.parametrize(
    "name,wrong,said",
    [
        ("u", np.zeros((4, 1)), "5 rows"),
        ("q", np.zeros((6, 2)), "5 rows"),
        ("v", np.zeros((5, 2, 1)), "5 rows"),
        ("t", np.zeros((5, 1)), r"\(N,\) times"),
        ("t", [], r"N ≥ 1"),
        ("t", [0, 1, 1, 2, 3], "after 1.0 s in row 2"),
        ("t", [0, 3, 1, 2, 4], "after 3.0 s in row 2"),
        ("v", [[1, 2], [3]], "real numbers"),
        ("u", "ramp", "real numbers"),
        ("u", 1j * np.ones(5), "real numbers"),
        ("q", np.where(np.arange(10).reshape(5, 2) == 7, np.nan, 0.0), "row 3, column 1"),
        ("t", [0, 1, np.inf, 3, 4], "inf in row 2"),
    ],
)
def test_an_invalid_log_raises_an_error_naming_the_fault(name, wrong, said):
    with pytest.raises(InvalidInput, match=said) as raised:
        Log(**(GOOD | {name: wrong}))
    assert raised.value.name == name


@FEW
@given(st.sampled_from(PARTS), nested)
def test_any_input_makes_a_valid_log_or_raises_a_typed_error(name, anything):
    try:
        log = Log(**(GOOD | {name: anything}))
    except InvalidInput:
        return
    assert len(log.t) == len(log.q) == len(log.v) == len(log.u)
    assert all(np.isfinite(part).all() for part in log) and (np.diff(log.t) > 0).all()


@FEW
@given(st.sampled_from(PARTS), shapes)
def test_arrays_of_any_shape_make_a_valid_log_or_raise_a_typed_error(name, shape):
    try:
        log = Log(**(GOOD | {name: np.zeros(shape)}))
    except InvalidInput:
        return
    assert [part.ndim for part in log] == [1, 2, 2, 2]
    assert {len(part) for part in log} == {len(log.t)}


def test_replacing_a_column_of_a_log_checks_the_new_log():
    with pytest.raises(InvalidInput, match="rows"):
        Log(**GOOD)._replace(u=np.zeros((3, 1)))


def test_a_log_made_of_measurements_returns_the_same_measurements():
    rows = Log(**GOOD).rows
    again = Log.of(rows)
    assert all(np.array_equal(a, b) for a, b in zip(again, Log(**GOOD), strict=True))
    with pytest.raises(InvalidInput, match="one or more"):
        Log.of([])
    with pytest.raises(InvalidInput):
        Log.of([rows[0], Measurement(0.5, np.zeros(3), rows[0].v, rows[0].u)])


@pytest.mark.parametrize("backend", ["compiled", "pinocchio"])
@pytest.mark.parametrize("name,width", [("q", 5), ("v", 7), ("u", 1)])
def test_an_identifier_refuses_a_log_of_another_robot(backend, name, width):
    """Compiled loops would read beyond arrays that are too narrow."""
    plant = ArmPlant(robot="ur5", backend=backend).build(1e-3, 0)
    identifier = NullspaceAID().build(plant.system, plant.truth, 1e-3)
    sizes = {"q": 6, "v": 6, "u": 6} | {name: width}
    log = Log(1e-3 * np.arange(4), *(np.zeros((4, size)) for size in sizes.values()))
    start = identifier.init(Measurement(0.0, np.zeros(6), np.zeros(6), np.zeros(6)))
    with pytest.raises(InvalidInput, match="6 columns") as raised:
        identifier.follow(start, log)
    assert raised.value.name == name


def test_single_precision_and_column_slices_identify_like_plain_arrays():
    """As read from a table of floats: strided views, float32."""
    scenario = load("bluerov2")
    setup = Setup.of(scenario)
    identifiers = setup.identifiers()
    rng = np.random.default_rng(0)
    system = setup.system
    q = np.repeat(system.position(np.zeros((1, system.n))), 20, axis=0)
    table = np.hstack([q, 1e-4 * rng.standard_normal((20, system.n)), rng.uniform(-1, 1, (20, 8))])
    table = np.asfortranarray(table.astype(np.float32))
    t = 0.01 * np.arange(20)
    ends = []
    for rows in (table, table.astype(np.float64)):
        log = Log(t, rows[:, :7], rows[:, 7:13], rows[:, 13:])
        state, _ = identifiers[""].follow(identifiers[""].init(log.at(0)), log)
        assert state.status is Status.completed
        ends.append(state.theta_hat)
    np.testing.assert_array_equal(*ends)
