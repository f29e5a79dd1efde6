"""The law `memory` from starts at e^{±1} on the cone's blocks; scripts/starts.py runs more."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nsaid_mj.cone import cone_of, inside
from nsaid_mj.identifiers import Status
from scripts import starts


@cache
def log(name: str, seconds: float) -> starts.Log:
    return starts.simulate(name, 7, seconds)


def check(found: starts.Start) -> None:
    assert found.status == Status.completed.words
    assert not found.outside and not found.not_finite
    assert found.drift <= 1e-3  # else a run would have ended


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("name", ["remus100", "f1tenth"])
def test_a_start_far_off_stays_inside_and_comes_nearer(name, index):
    known = log(name, 5.0)
    found = starts.identify(known, index, starts.drawn(known, index, 1.0))
    check(found)
    assert found.time == pytest.approx(5.0)
    assert found.ratio is not None and found.ratio < 0.1 * found.ratio_initial


def test_starts_are_inside_and_differ_and_can_be_drawn_again():
    known = log("remus100", 5.0)
    cone = cone_of(known.plant.system.space)
    drawn = [starts.drawn(known, index, 1.0) for index in range(50)]
    assert all(inside(cone, theta) for theta in drawn)
    assert len({tuple(theta) for theta in drawn}) == 50
    np.testing.assert_array_equal(drawn[7], starts.drawn(known, 7, 1.0))
    off = np.abs(np.log(np.array(drawn)[:, cone.positive] / known.plant.truth[cone.positive]))
    assert 0.9 < off.max() <= 1.0 + 1e-12


def test_a_law_that_loses_definiteness_is_seen():
    """The paper's law with a gain far too large."""
    known = log("remus100", 5.0)
    law = replace(known.law, law="paper", gain=1e4)
    broken = replace(known, law=law)
    found = [starts.identify(broken, k, starts.drawn(broken, k, 1.0)) for k in range(3)]
    lost = [
        s for s in found
        if s.outside or s.status == Status.estimate_not_positive_definite.words
    ]  # fmt: skip
    assert lost and all(s.ratio is None and s.time < 5.0 for s in lost)
    assert f"| 3 | {len(lost)} | 0 | 3 |" in starts.row("remus100", found)
    assert len(list(starts.failures(found))) == 3


@pytest.mark.slow
@pytest.mark.parametrize("name", starts.VEHICLES)
def test_vehicles_find_the_true_set_from_any_start(name):
    for index in range(5):
        known = log(name, 20.0)
        found = starts.identify(known, index, starts.drawn(known, index, 1.0))
        check(found)
        assert found.near, found
