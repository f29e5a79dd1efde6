"""The comparison of directions detects a change of an estimate, but not of its length or sign."""

import numpy as np
import pytest

from tests.recovery import direction


@pytest.mark.parametrize("factor", [3.0, -2.0, 1e-6])
def test_a_direction_does_not_depend_on_length_and_sign(factor):
    rng = np.random.default_rng(0)
    theta, scale = rng.normal(size=7), rng.uniform(0.5, 2, 7)
    assert np.allclose(direction.of(factor * theta, scale), direction.of(theta, scale), atol=1e-15)


def test_a_moved_entry_is_named_with_old_and_new():
    old = {"m_1": 0.6, "gain_1": 0.8}
    assert direction.changes(old, {"m_1": 0.6 + 5e-7, "gain_1": 0.8}) == []
    (line,) = direction.changes(old, {"m_1": 0.6, "gain_1": 0.8001})
    assert line.split() == ["gain_1", "+0.800000000", "->", "+0.800100000"]


def test_a_missing_or_new_parameter_is_a_change():
    assert len(direction.changes({"a": 1.0}, {"b": 1.0})) == 2
