"""The pieces of the adversarial study: its robots, its effects, and its judge, both ways."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.core.parameters import Block, ParameterSpace
from nsaid_mj.lab.evaluation.statistics import Correlations, StatedConfidence
from nsaid_mj.lab.plants.world.faults.kinds import Loss
from tests.court import command
from tests.court.cases import LAWS, Case, drawn
from tests.court.effects import EFFECTS
from tests.court.judging import Judgement, judge_gains, judge_online
from tests.court.online import Stated, trace_of
from tests.court.robots import random_tree, rotation, with_wrong_masses
from tests.court.simulation import NotRun, simulated
from tests.court.table import bars, by_effect, kind_of, moved, overall, unseen


def least_moment(urdf: str) -> float:
    """The smallest second moment of mass of all bodies, over the body's largest."""
    found = []
    for inertial in ElementTree.fromstring(urdf).iter("inertial"):
        origin, inertia, mass = (inertial.find(part) for part in ("origin", "inertia", "mass"))
        assert origin is not None and inertia is not None and mass is not None
        assert float(mass.get("value", "")) > 0
        entry = {name: float(value) for name, value in inertia.attrib.items()}
        upper = np.array([[entry.get(f"i{a}{b}", 0.0) for b in "xyz"] for a in "xyz"])
        matrix = upper + np.triu(upper, 1).T
        turn = rotation(np.array([float(x) for x in origin.get("rpy", "").split()]))
        moments = np.linalg.eigvalsh(turn @ (0.5 * np.trace(matrix) * np.eye(3) - matrix) @ turn.T)
        found.append(moments[0] / moments[-1])
    return min(found)


def test_the_bodies_of_random_trees_exist_and_some_are_very_flat():
    trees = [random_tree(np.random.default_rng([3, k]), 2 + k % 8) for k in range(200)]
    least = np.array([least_moment(tree) for tree in trees])
    assert (least > 0).all()
    assert np.mean(least < 1e-3) > 0.1
    for tree in trees[:20]:
        assert least_moment(with_wrong_masses(tree, np.random.default_rng(0), 0.25)) > 0
    flat = trees[0].replace('ixx="', 'ixx="-')
    assert least_moment(flat) < 0


def test_random_trees_are_branched_and_of_all_kinds_of_joints():
    kinds, branched = set(), 0
    for k in range(60):
        root = ElementTree.fromstring(random_tree(np.random.default_rng([4, k]), 9))
        kinds |= {joint.get("type") for joint in root.iter("joint")}
        parents = [p.get("link") for p in root.iter("parent")]
        branched += len(set(parents)) < len(parents)
        assert len(parents) == 9
    assert kinds == {"revolute", "continuous", "prismatic"}
    assert branched > 20


# -- cases and effects -----------------------------------------------------------------------------


def test_a_seed_draws_the_same_cases_and_another_seed_others():
    assert [drawn(1, k) for k in range(30)] == [drawn(1, k) for k in range(30)]
    assert drawn(1, 0).stream(1).random() != drawn(2, 0).stream(1).random()


def test_every_law_and_every_effect_in_every_size_is_drawn():
    cases = [drawn(6, k) for k in range(6000)]
    assert {case.law for case in cases} == set(LAWS)
    sizes = {(case.effect, case.size) for case in cases}
    assert sizes == {("none", 0.0)} | {(n, float(s)) for n, e in EFFECTS.items() for s in e.sizes}


def test_runs_of_a_group_share_all_but_the_effect():
    for k in range(0, 90, 3):
        control, *others = (drawn(2, k + member) for member in range(3))
        assert control.effect == "none"
        assert others[0].effect != others[1].effect
        for other in others:
            assert replace(other, number=k, effect="none", size=0.0) == control


def short(kind: str, effect: str = "none", size: float = 0.0) -> Case:
    """Some tenths of a second of a robot of a kind."""
    robot = {"arm": "z1", "rov": "bluerov2", "torpedo": "remus100", "quad": "hummingbird"}[kind]
    shared = robot, kind, "own", "stock", "drawn", None, 0.6, 2e-3 if kind == "arm" else 0.0
    return Case(0 if effect == "none" else 1, 8, "efficient", *shared, effect, size)


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_changes_the_log_the_more_the_larger_it_is(effect: str):
    kind, sizes = EFFECTS[effect].robots[0], EFFECTS[effect].sizes
    sound = simulated(short(kind)).log
    changes = []
    for size in (sizes[0], sizes[-1]):
        try:
            log = simulated(short(kind, effect, float(size))).log
        except NotRun:
            changes.append(np.inf)
            continue
        changes.append(np.abs(log.v - sound.v).max() + np.abs(log.u - sound.u).max())
    assert changes[0] > 0
    if effect not in ("noise", "elastic"):  # their sizes are ratios and frequencies
        assert changes[1] > changes[0]


# -- the judge -------------------------------------------------------------------------------------

SPACE = ParameterSpace(
    (
        Block("mass", ("m",), ("kg",), np.ones(1), "positive"),
        Block("gain", ("k_1", "k_2"), ("N", "N"), np.ones(2), "positive", actuator=True),
    )
)
LOST = FaultEvent(1.0, 1.5, "loss", "gain of 1", ("k_1",), 0.4, 0.3, 0.5, "1", 1.0)


class System:
    """A structure of one mass and two gains."""

    space = SPACE


def stated(
    theta=(2.0, 1.0, 1.0), covered=1.0, deviation=0.01, misfit: str | None = "none", events=()
) -> Stated:
    """What a law might say where the truth is 1 for all gains."""
    confidence = StatedConfidence(
        directions=2,
        below_noise=0,
        covered=covered,
        deviation_median=0.01,
        deviation_largest=0.02,
        independent_samples=(),
        actuators={"k_1": deviation, "k_2": deviation},
        parameters={},
        correlations=Correlations(),
        worst_known=(),
    )
    values = np.array(theta), np.array([2.0, 1.0, 1.0])
    return Stated("completed", *values, misfit, 1.0, confidence, tuple(events))


def said(found: Stated, effect: str = "none", faults=()) -> str:
    """The judge's words."""
    judgement = judge_online(found, System(), effect, faults)  # type: ignore[arg-type]
    return kind_of(judgement.keys() | {"outcome": "judged"})


def test_a_right_result_is_right_and_confident():
    assert said(stated()) == "right, confident"


@pytest.mark.parametrize(
    "planted",
    [
        stated(covered=0.5),
        stated(theta=(2.0, 1.3, 1.0)),
        stated(theta=(2.0, -1.0, 1.0)),
        stated(deviation=np.nan),
        stated(covered=np.nan),
        stated(events=[LOST]),
        stated(covered=0.5, misfit=None),
    ],
    ids=["coverage", "gain", "sign", "NaN", "NaN coverage", "fault", "no verdict"],
)
def test_a_planted_wrong_result_is_wrong_and_confident(planted: Stated):
    assert said(planted) == "wrong, confident"
    warned = planted.misfit is None or said(replace(planted, misfit="some"))
    assert warned in (True, "wrong, flagged")


def test_wide_intervals_are_unsure_and_a_misfit_is_a_flag():
    vague = stated()
    assert vague.confidence is not None
    vague = replace(vague, confidence=replace(vague.confidence, below_noise=2))
    assert said(vague) == "right, unsure"
    assert said(stated(misfit="contradicts")) == "right, flagged"
    assert said(stated(theta=(2.0, 1.3, 1.0), deviation=0.1)) == "right, confident"


def test_what_a_true_fault_and_a_fading_gain_may_be_called(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Loss, "affected", lambda fault, system: np.array([fault.actuator]))
    true, other = Loss(actuator=1, share=0.4), Loss(actuator=2, share=0.4)
    reversed_one = LOST._replace(kind="reversed")
    for effect in ("loss", "sag", "drift"):
        assert said(stated(events=[LOST]), effect, [true]) == "right, confident"
        assert said(stated(events=[LOST]), effect, [other]) == "wrong, confident"
        assert said(stated(events=[reversed_one]), effect, [true]) == "wrong, confident"
    unknown = LOST._replace(kind="unknown")
    assert said(stated(events=[unknown])) == "right, flagged"


def test_gains_are_judged_relative_to_the_common_scale():
    same, off = Judgement(), Judgement()
    judge_gains(same, np.array([1.5, 1.5, 1.5]), np.full(3, 1e-3))
    judge_gains(off, np.array([1.5, 1.5, 1.6]), np.full(3, 1e-3))
    assert not same.wrong
    assert off.wrong


def test_an_effect_leaves_the_more_of_a_trace_the_larger_it_is():
    none, small, large = (
        trace_of(short("arm", name, size))
        for name, size in (("none", 0.0), ("delay", 1.0), ("delay", 25.0))
    )
    assert none == 0 and large > 100 * max(small, 1.0)
    hidden, plain = (
        Judgement(wrong=["a"], coverage=0.5, figures={"trace": trace}) for trace in (1.0, 30.0)
    )
    assert unseen(line(short("arm"), hidden)) and not unseen(line(short("arm"), plain))
    assert not unseen(line(short("arm"), Judgement(wrong=["a"], coverage=0.5)))


# -- lines and tables ------------------------------------------------------------------------------


def line(case: Case, judgement: Judgement) -> dict:
    """A line of the study."""
    keys = {"law": case.law, "number": case.number, "effect": case.effect, "size": case.size}
    return {"case": keys, "words": case.words, "outcome": "judged"} | judgement.keys()


def test_the_tables_count_every_run_once():
    right = Judgement(gain_errors=[0.01, -0.01], gain_deviations=[0.01, 0.01], coverage=1.0)
    wrong = Judgement(wrong=["a"], gain_errors=[0.1, -0.1], gain_deviations=[0.01] * 2, coverage=0)
    lines = [line(short("arm"), right), line(short("arm", "lag", 5.0), wrong)]
    crash = {"case": lines[1]["case"], "words": "", "outcome": "crash", "error": "KeyError"}
    assert "| efficient | 3 | 1 | 0 | 0 | 0 | 1 | 1 | 0 |" in overall([*lines, crash])
    assert "| 0.0 % (0/1) | – (0) |" in bars(lines)
    assert "| lag | 5 time steps | 1 | 0 | 0 | 1 | 0 | 0 | 1 | 0 | 0 |" in by_effect(lines)
    assert moved(lines[1], lines[0])
    assert not moved(lines[0], lines[0])


def test_an_exception_and_a_run_too_long_are_crashes(monkeypatch: pytest.MonkeyPatch):
    def fails(_: Case) -> Judgement:
        raise KeyError("missing")

    def hangs(_: Case) -> Judgement:
        while True:
            pass

    monkeypatch.setattr(command, "judged", fails)
    found = command.line_of(short("arm"))
    assert found["outcome"] == "crash" and "KeyError" in found["error"]
    monkeypatch.setattr(command, "judged", hangs)
    assert "TooSlow" in command.line_of(short("arm"), limit=0.2)["error"]
