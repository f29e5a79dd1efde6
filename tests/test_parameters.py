"""Parameter spaces: blocks partition θ, names give places, malformed blocks are refused."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput, NsaidError, UnknownName
from nsaid_mj.core.parameters import Block, ParameterSpace, finite, number

FEW = settings(deadline=None, max_examples=50)
BAD = [np.nan, np.inf, -np.inf]


def block(name="b", size=2, scale=1.0, **more) -> Block:
    names = tuple(f"{name}_{i}" for i in range(size))
    return Block(name, names, ("kg",) * size, np.full(size, scale), **more)


@st.composite
def spaces(draw):
    sizes = draw(st.lists(st.integers(1, 6), min_size=1, max_size=6))
    return ParameterSpace(
        tuple(
            Block(
                f"block {k}",
                tuple(f"p{k}_{i}" for i in range(size)),
                tuple(f"unit{k}_{i}" for i in range(size)),
                np.array(draw(st.lists(st.floats(1e-6, 1e6), min_size=size, max_size=size))),
                draw(st.sampled_from(["free", "positive"])),
                draw(st.booleans()),
            )
            for k, size in enumerate(sizes)
        )
    )


@FEW
@given(spaces())
def test_blocks_partition_theta_in_order(space):
    indices = [i for _, place in space for i in range(place.start, place.stop)]
    assert indices == list(range(len(space)))
    for block, place in space:
        assert space[block.name] == place
        assert tuple(space.names[place]) == block.names
        assert tuple(space.units[place]) == block.units
        assert (space.scale[place] == block.scale).all()


@FEW
@given(spaces())
def test_a_block_name_gives_its_slice_and_actuators_index_their_blocks(space):
    assert [space.index(name) for name in space.names] == list(range(len(space)))
    owner = [block for block, _ in space for _ in range(len(block))]
    assert space.actuators.tolist() == [i for i, block in enumerate(owner) if block.actuator]
    assert np.arange(len(space))[space.actuators].shape == space.actuators.shape  # can index


def test_scale_is_a_read_only_copy():
    mine = np.ones(2)
    b = Block("b", ("x", "y"), ("kg", "kg"), mine)
    mine[:] = 7.0
    space = ParameterSpace((b,))
    assert space.scale.tolist() == [1.0, 1.0]
    for scale in (b.scale, space.scale):
        with pytest.raises(ValueError, match="read-only"):
            scale[0] = 2.0


@pytest.mark.parametrize("bad", [0.0, -1.0, *BAD])
def test_a_scale_is_finite_and_positive(bad):
    with pytest.raises(InvalidInput) as caught:
        Block("b", ("x", "y"), ("kg", "kg"), np.array([1.0, bad]))
    assert caught.value.name == "scale" and "'b'" in caught.value.remedy


@pytest.mark.parametrize("scale", [np.ones(3), np.ones((2, 1)), np.float64(1.0)])
def test_a_scale_has_one_entry_for_each_name(scale):
    with pytest.raises(InvalidInput) as caught:
        Block("b", ("x", "y"), ("kg", "kg"), scale)
    assert caught.value.name == "scale"


def test_units_have_one_entry_for_each_name():
    with pytest.raises(InvalidInput) as caught:
        Block("b", ("x", "y"), ("kg",), np.ones(2))
    assert caught.value.name == "units"


@pytest.mark.parametrize(
    "geometry,size", [("pseudo_inertia", 9), ("pseudo_inertia", 11), ("spd", 2), ("spd", 20)]
)
def test_a_geometry_fixes_the_number_of_parameters(geometry, size):
    with pytest.raises(InvalidInput) as caught:
        block(size=size, geometry=geometry)
    assert caught.value.name == "names"


@pytest.mark.parametrize("geometry,size", [("pseudo_inertia", 10), ("spd", 1), ("spd", 21)])
def test_a_geometry_of_the_right_size_is_accepted(geometry, size):
    assert len(block(size=size, geometry=geometry)) == size


GOOD = ((0, 0, 0, 1.0), (1, 1, 1, 2.0), (1, 0, 2, -1.0))


def test_a_tied_block_needs_its_entries():
    names, units = ("a", "b", "c"), ("kg", "kg", "kg·m")
    assert Block("M", names, units, np.ones(3), "tied", entries=GOOD).entries == GOOD
    bad: tuple[Any, ...] = (
        (),
        GOOD[:2],
        GOOD[1:],  # nothing; a parameter without a place
        (*GOOD, (1, 0, 2, 1.0)),
        (*GOOD, (1, 0, 1, 1.0)),  # a place twice
        (*GOOD, (2, 1, 1, 1.0)),
        (*GOOD, (2, 1, 2, 1.0)),  # on and off the diagonal; a gap in it
        (*GOOD, (0, 1, 2, 1.0)),
        (*GOOD, (2, 2, 3, 1.0)),  # above the diagonal; no such parameter
        (*GOOD, (2, 2, 0)),
        (*GOOD, (2, 2, 0, 0.0)),
        (*GOOD, (2, 2, 0, -1.0)),
        (*GOOD, (2, 2, 0, np.nan)),
    )
    for entries in bad:
        with pytest.raises(InvalidInput) as caught:
            Block("M", names, units, np.ones(3), "tied", entries=entries)
        assert caught.value.name == "entries"
    with pytest.raises(InvalidInput) as caught:
        Block("M", names, units, np.ones(3), "spd", entries=GOOD)
    assert caught.value.name == "entries"


def test_an_unknown_geometry_lists_the_known_ones():
    with pytest.raises(UnknownName) as caught:
        block(geometry="positiv")
    assert caught.value.near == ("positive",) and "spd" in caught.value.choices


def test_names_are_unique():
    with pytest.raises(InvalidInput, match="'b' twice"):
        ParameterSpace((block("b"), Block("b", ("other",), ("kg",), np.ones(1))))
    with pytest.raises(InvalidInput, match="'b_0' twice"):
        ParameterSpace((block("b"), Block("c", ("b_0",), ("kg",), np.ones(1))))


def test_an_unknown_block_or_parameter_gives_near_names():
    space = ParameterSpace((block("motor gain"),))
    with pytest.raises(UnknownName) as caught:
        space["motor gian"]
    assert caught.value.near == ("motor gain",)
    with pytest.raises(UnknownName, match="Did you mean motor gain_") as caught:
        space.index("motor gain_7")
    assert set(caught.value.near) == {"motor gain_0", "motor gain_1"}
    assert isinstance(caught.value, KeyError) and not str(caught.value).startswith("'")


@FEW
@given(st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=3))
def test_check_returns_the_same_numbers(theta):
    space = ParameterSpace((block(size=3),))
    checked = space.check(theta)
    assert checked.dtype == np.float64 and checked.tolist() == theta


@pytest.mark.parametrize("theta", [np.ones(2), np.ones(4), np.ones((1, 3)), 1.0])
def test_check_refuses_another_shape(theta):
    with pytest.raises(InvalidInput, match=r"theta: expected an array of shape \(3,\)"):
        ParameterSpace((block(size=3),)).check(theta)


@FEW
@given(st.integers(0, 2), st.integers(0, 3), st.sampled_from(BAD))
def test_finite_names_the_entry_that_is_not(i, j, bad):
    array = np.zeros((3, 4))
    array[i, j] = bad
    with pytest.raises(InvalidInput) as caught:
        finite("X", array, (3, 4), "Do this.")
    error = caught.value
    assert isinstance(error, NsaidError) and isinstance(error, ValueError)
    assert error.name == "X" and f"({i}, {j})" in str(error) and str(error).endswith("Do this.")


def test_labels_default_to_names():
    space = ParameterSpace(
        (
            Block("mass", ("m_1", "m_2"), ("kg", "kg"), np.ones(2), labels=("cart", "pole")),
            Block("drag", ("d",), ("N·s/m",), np.ones(1)),
        )
    )
    assert space.labels == ["cart", "pole", "d"]
    assert space.names == ["m_1", "m_2", "d"]


def test_labels_have_one_entry_for_each_name():
    with pytest.raises(InvalidInput, match="2 labels, or none, got 1"):
        Block("mass", ("m_1", "m_2"), ("kg", "kg"), np.ones(2), labels=("cart",))


@given(st.floats(-1e307, 1e307), st.integers(1, 6))
def test_any_number_is_written_with_its_size(value: float, significant: int):
    text = number(value, significant=significant)
    plain = text.replace("·10", "e").translate(str.maketrans("−⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "--0123456789"))
    assert float(plain) == pytest.approx(value, rel=10.0 ** (1 - min(significant, 4)), abs=1e-300)
