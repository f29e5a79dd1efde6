"""Some short runs of the adversarial study, and a hundred slow ones: none is wrong and confident.

`scripts/court.py` says what the words mean, and runs as many as one likes; its `--case K` tells a
run at length.
"""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from nsaid_mj.core.laws.base import Confidence
from nsaid_mj.lab.evaluation.run_misfit import filter_of
from nsaid_mj.watch import Misfit, widened
from tests.court.cases import LAWS, Case, drawn
from tests.court.command import cases, line_of
from tests.court.simulation import simulated
from tests.court.table import kind_of, unseen, worst

FEW = {
    (1, "efficient"): (0, 7, 8),
    (2, "memory"): (2,),
    (3, "identify"): (2,),
}
"""Runs of the short study, by seed and law: the cheaper ones of the first there are."""
SLOW = {(1, "efficient"): (5,), (3, "identify"): (0,)}
"""Further ones, of a law and a kind of flaw that the others have, too."""
MANY = 4  # seed of the long one, of which the first hundred are run
_MOST, _UNSEEN = 1, 3  # of the hundred that may be wrong and confident, seen and unseen by any test
_LIMIT = 600.0  # of a run, which may have to compile kernels [s]


def check(line: dict) -> None:
    """Asserts that a run did not crash and that its intervals are numbers."""
    assert line["outcome"] != "crash", line["error"]
    assert not any("is not a number" in wrong for wrong in line.get("wrong", [])), line["words"]


def drawn_of(few: dict[tuple[int, str], tuple[int, ...]]) -> list[Case]:
    return [drawn(seed, number, [law]) for (seed, law), runs in few.items() for number in runs]


SHORT: list = drawn_of(FEW)
GEARS = [drawn(1, 10, ["efficient"]), drawn(4, 4, LAWS)]
"""Wrong gear ratios, the second once taken for a spring of negative stiffness."""
SHORT += [pytest.param(case, marks=pytest.mark.slow) for case in GEARS + drawn_of(SLOW)]


@pytest.mark.parametrize("case", SHORT, ids=lambda case: case.words)
def test_a_run_is_not_wrong_and_confident(case: Case):
    line = line_of(case, _LIMIT, verbose=True)
    check(line)
    assert kind_of(line) != "wrong, confident", line["wrong"]


def test_noise_of_a_small_motion_is_not_taken_for_an_effect():
    """Encoder steps on a UR5 that hardly moves were once an elastic joint and a lag."""
    line = line_of(drawn(77, 54, ["identify"]), _LIMIT, verbose=True)
    check(line)
    assert not line["wrong"] and not line["flagged"]


@pytest.mark.slow
def test_hardly_any_of_a_hundred_runs_is_wrong_and_confident():
    lines = [line_of(case, _LIMIT) for case in islice(cases(MANY, LAWS, ""), 100)]
    for line in lines:
        check(line)
    found = [line for line in lines if kind_of(line) == "wrong, confident"]
    seen = [line for line in found if not unseen(line)]
    assert len(seen) <= _MOST and len(found) - len(seen) <= _UNSEEN, worst(found)
    assert sum(line["outcome"] == "not run" for line in lines) <= 5


def test_a_weakly_coupled_gain_is_not_stated_more_surely_than_it_is_known():
    """An arm of exact structure that moves one joint at a time.

    After 2.5 s the last gain was 12 stated deviations off, by what the filter had learned while it
    was linearised far from the truth; no innovation contradicted it.
    """
    found = simulated(drawn(20261128, 39, ["efficient"]))
    setup, log = found.setup, found.log.until(2.53)
    identifier, space = setup.identifiers()[""], setup.system.space
    state, _ = identifier.follow(identifier.init(log.at(0)), log)
    alone, stated = filter_of(setup.scenario, setup.system), identifier.confidence(state)
    assert alone is not None and stated is not None
    judged = Misfit.of_estimate(alone, state.theta_hat, stated, setup.prior, log)
    ratio = state.theta_hat[space.actuators] / setup.plant.truth[space.actuators]
    error = np.abs(ratio / ratio.mean() - 1)
    own, wider = (
        np.max(error / Confidence.of_gains(one, state.theta_hat, space))
        for one in (stated, widened(stated, judged.widening))
    )
    assert own > 6 and wider < 0.5 * own
