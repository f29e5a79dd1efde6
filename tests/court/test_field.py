"""The judge of users' logs: what counts as named, as right, and as wrong and confident."""

from types import SimpleNamespace

import pytest

from nsaid_mj.base.findings import Finding
from tests.court import field
from tests.court.field import Tried, judge_cause, numbers
from tests.court.field_causes import Drawn
from tests.court.field_study import failures, group_of, line_of, table, wrong
from tests.court.judging import Judgement
from tests.support.robot_logs import arm_log, two_joints

CLOCK = Finding("refusal", "clock", "log_2.csv", "the clock runs twice too fast")
UNIT = Finding("refusal", "velocity_mismatch", "elbow", "the velocity is wrong")
NOTE = Finding("note", "gap", "", "a gap")


def tried(*findings: Finding, codes: tuple[str, ...] = ("clock",), where: str = "log_2") -> Tried:
    found = Tried("a draw")
    before = SimpleNamespace(findings=findings)
    judge_cause(found, SimpleNamespace(before=before), codes, (where,))  # type: ignore[arg-type]
    return found


def test_only_the_true_cause_first_counts_as_named():
    assert tried(NOTE, CLOCK).named and tried(CLOCK).alone
    assert not tried(UNIT, CLOCK).named and not tried(UNIT, CLOCK).alone
    assert not tried(CLOCK, where="log_1").named
    assert not tried(NOTE).named  # missed
    assert tried(NOTE, codes=()).named and not tried(CLOCK, codes=()).named  # of a healthy log


def result(value: float, half: float, status: str = "identified", explains: str = "yes"):
    p = SimpleNamespace(
        name="gain_1",
        label="gain of elbow",
        unit="N·m",
        value=value,
        low=value - half,
        high=value + half,
        status=status,
        relative=None,
    )
    return SimpleNamespace(parameters=[p], explains=explains)


@pytest.mark.parametrize(
    ("found", "said", "right"),
    [
        (result(3.0, 0.1), True, False),  # three times too large, and the verdict is yes
        (result(3.0, 0.1, explains="partly"), False, False),
        (result(3.0, 1.0), False, True),  # its interval is wide
        (result(3.0, 0.1, status="only in combination"), False, True),
        (result(1.01, 0.001), False, True),  # an error of 1 %
    ],
)
def test_a_wrong_number_that_nothing_doubts_is_wrong_and_confident(found, said, right, monkeypatch):
    monkeypatch.setattr(field, "doubted", lambda result: result.explains != "yes")
    draw = Tried("a draw", named=True)
    draw.believe(numbers(found, {"gain of elbow": 1.0}))
    line = draw.keys() | {"kind": "clock", "seed": 3}
    assert (wrong(line), line["right"]) == (said, right)
    assert ("WRONG, CONFIDENT" in failures([line])) == said


def test_a_doubted_answer_after_a_confident_one_hides_nothing():
    draw = Tried("a draw")
    draw.believe(Judgement(wrong=["gain_1"]))
    draw.believe(Judgement(wrong=["gain_2"], flagged=["partly"]))
    assert draw.confident and draw.wrong == ["gain_1"] and draw.right is False


def test_a_mended_log_that_is_refused_does_not_end_right():
    draw = Tried("a draw")
    draw.believe(Judgement(flagged=["short"], figures={"refused": True}))
    assert draw.right is False and not draw.confident


def test_the_table_counts_each_kind_and_all():
    good = Tried("x", named=True, alone=True, right=True).keys()
    bad = Tried("x", alone=False, right=False, confident=True, wrong=["gain_1"]).keys()
    lines = [
        good | {"kind": "clock", "seed": 0},
        bad | {"kind": "clock", "seed": 1},
        good | {"kind": "healthy", "seed": 0, "right": None},
        {"kind": "healthy", "seed": 1, "outcome": "crash", "error": "ValueError"},
        {"kind": "healthy", "seed": 2, "outcome": "not run", "error": "the plant diverged"},
    ]
    rows = table(lines).splitlines()
    assert "| clock | 2 | 1/2 | 1/2 | 1/2 | 1/2 | 0 |" in rows
    assert "| healthy | 2 | 1/1 | 1/1 | – | 0/1 | 1 |" in rows
    assert table(lines, str).splitlines()[2:] == rows[2:]  # here each kind is a group of its own
    assert rows[-1] == "| **all** | 4 | 2/3 | 2/3 | 1/2 | 1/3 | 1 |"
    assert len(failures(lines).splitlines()) == 2


def test_kinds_are_grouped_by_what_is_wrong():
    groups = {kind: group_of(kind) for kind in field.KINDS}
    assert groups["vehicle's clock of a file"] == groups["clock without velocities"] == "clock"
    assert groups["Euler angles, healthy"] == groups["phases: gentle"] == "healthy"
    assert groups["Euler angles, all in NED"] == groups["twist in FRD"] == "frames"
    assert groups["Euler angles, rates in deg/s"] == "units, motor side"
    assert groups["walking: commands swapped"] == "robots that walk"
    assert groups["PD law"] == "PD law" and len(set(groups.values())) == 15


def test_a_cause_is_named_and_a_remedy_that_does_not_restore_the_log_is_tried(
    monkeypatch, tmp_path
):
    """What `identify` then says counts, here that a number is wrong."""
    good, _ = arm_log(two_joints(), 0, duration=8.0)
    reversed_ = {name: -x if "current" in name else x for name, x in good.items()}
    run = SimpleNamespace(case=SimpleNamespace(robot="two joints"))
    said = (("reversed_sign",), (), "commands negated")
    drawn = Drawn("reversed commands", "", (reversed_,), (good,), "", (), *said, run)
    monkeypatch.setattr(field.field_causes, "draw", lambda *_: drawn)
    monkeypatch.setattr(field, "load_robot_model", lambda *_: two_joints())
    monkeypatch.setattr(field, "_judged", lambda *_: Judgement(wrong=["gain_1"]))
    line = line_of(("reversed commands", 0))
    assert line["named"] and line["alone"] and line["right"] and not wrong(line), line
    monkeypatch.setattr(field, "same", lambda *_: False)
    found = field.cause("reversed commands", 0, tmp_path)
    assert found.named and found.right is False and found.confident and found.wrong == ["gain_1"]
