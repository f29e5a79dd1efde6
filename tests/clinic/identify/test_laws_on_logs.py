"""Laws of the paper along logs of files, beside the batch fit."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.cli.commands import command
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.law import law_findings, law_logs
from nsaid_mj.clinic.identify.result import AlongLog, GainRatio, Identification
from nsaid_mj.clinic.session import Session
from nsaid_mj.lab.postprocessing import finish, rebuild
from nsaid_mj.lab.record import Record
from tests.support.identification import identification
from tests.support.robot_logs import arm_log, two_joints, write_csv

URDF = """<robot name="two"><link name="base"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="99" velocity="9"/></joint>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.4 0 0"/><axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="99" velocity="9"/>
</joint><link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> tuple[str, Path, dict[str, float]]:
    """A model, a log with a gap and currents of hidden gains, and the true values."""
    place = tmp_path_factory.mktemp("arm")
    model = place / "two.urdf"
    model.write_text(URDF, encoding="utf-8")
    values, true = arm_log(two_joints(), 3, duration=24.0)
    kept = np.abs(values["time"] - 10.0) > 0.4
    log = write_csv(place / "log.csv", {name: x[kept] for name, x in values.items()})
    return str(model), log, true


def identified(arm, law: str, folder: Path | None = None) -> Identification:
    model, log, _ = arm
    return identify_forces(model, log, law=law, folder=folder, columns=[], delay=0.0)


@pytest.fixture(scope="module")
def remembered(arm, tmp_path_factory) -> Identification:
    """What `memory` finds, with a folder of its run."""
    return identified(arm, "memory", tmp_path_factory.mktemp("memory"))


@pytest.mark.parametrize("law,near", [("efficient", 0.1), ("memory", 0.1), ("cone", 0.4)])
def test_a_law_finds_the_gains_of_a_log(arm, remembered, law, near):
    """The prior of gains in an unknown unit is a guess from the log."""
    found = remembered if law == "memory" else identified(arm, law)
    along, true = found.law, arm[2]
    assert along is not None and along.completed
    gains = np.array([true["gain_1"], true["gain_2"]])
    ratios = gains / np.sqrt(gains[0] * gains[1])
    np.testing.assert_allclose([gain.law for gain in along.gains], ratios, rtol=near)
    if law != "cone":
        for gain, ratio in zip(along.gains, ratios, strict=True):
            assert abs(np.log(gain.law / ratio)) <= gain.half
            assert not gain.apart


def test_no_fault_is_named_where_the_structure_is_not_exact():
    """A real arm's unmodelled effects; a payload was named in them, and the estimate lost by it."""
    along = identify_forces("tx40", law="efficient").law
    assert along is not None and not along.run.faults
    assert np.median(along.last / along.batch_last) < 2


def test_the_papers_law_follows_a_log_without_intervals(arm):
    along = identified(arm, "paper").law
    assert along is not None and along.completed
    assert all(np.isinf(gain.half) and not gain.apart for gain in along.gains)


def test_a_law_on_a_log_and_live_give_the_same_bits(remembered, tmp_path):
    assert remembered.law is not None
    run = remembered.law.run
    gap = np.diff(run.record["t"]) > 1.5 * run.scenario.dt
    assert gap.sum() == 1
    lines = [
        json.dumps({"t": t, "q": q.tolist(), "v": v.tolist(), "u": u.tolist()})
        for t, q, v, u in zip(*(run.record[name] for name in "tqvu"), strict=True)
    ]
    stream = io.BytesIO(("\n".join(lines) + "\n").encode())
    live = Session(run.scenario).run(stream, tmp_path / "live", lambda _: None)
    for name in ("t", "q", "v", "u", "v_hat", "theta_hat"):
        np.testing.assert_array_equal(live.record[name], run.record[name])


def test_a_record_of_a_log_is_opened_again(remembered):
    assert remembered.law is not None
    run = remembered.law.run
    result = finish(run)
    assert (run.folder / "report.html").is_file() and result.law.law == "memory"
    again = rebuild(run.folder)
    assert again.estimates == result.estimates
    assert len(Record.read(run.folder)) == len(run.record)


def test_logs_of_a_law_are_on_one_clock_and_commands_lie_between_samples(arm):
    from nsaid_mj.clinic.identify.models import load_robot_model
    from nsaid_mj.clinic.logs.preparation import prepare
    from nsaid_mj.clinic.logs.tables import read_tables

    robot = load_robot_model(arm[0])
    recordings = prepare(read_tables([arm[1]]), None, robot)
    assert len(recordings.segments) == 2
    made = identified_structure(robot, recordings)
    logs, start, rate = law_logs(robot, recordings, made)
    assert logs[0].t[0] == 0 and start == recordings.segments[0].log.t[0]
    assert logs[1].t[0] > logs[0].t[-1] + 1.5 / rate
    half = np.full(2, 0.5 / rate)
    early, late = (law_logs(robot, recordings, made._replace(delays=d))[0] for d in (-half, half))
    for one, other in zip(early, late, strict=True):  # a sample later, half of it before the middle
        np.testing.assert_allclose(one.u[:-2], other.u[1:-1], atol=1e-9)
    inside = (logs[0].u - early[0].u) * (logs[0].u - late[0].u) <= 1e-3
    assert inside.mean() > 0.9


def identified_structure(robot, recordings):
    from nsaid_mj.clinic.identify.choose.joint_search import structured_arm
    from nsaid_mj.clinic.identify.result import Options

    options = Options(frozenset({"rotor", "viscous", "coulomb"}), delay=np.zeros(2))
    return structured_arm(robot, recordings, None, options, lambda _: None)


def test_a_law_apart_from_the_batch_fit_is_told():
    along = identification(law=True).law
    assert along is not None
    assert law_findings(along) == []
    apart = replace(along, gains=(GainRatio("gain of elbow", 1.5, 0.1, 1.0, 0.1), *along.gains[1:]))
    (finding,) = law_findings(apart)
    assert finding.level == "warning" and "gain of elbow" in finding.text


def test_a_law_without_intervals_is_never_told_apart():
    gain = GainRatio("gain of elbow", 1.5, np.inf, 1.0, 0.1)
    assert not gain.apart and np.log(gain.law / gain.batch) <= gain.half
    assert isinstance(identification().law, AlongLog | None)


def test_an_unknown_law_is_refused_before_the_log_is_read():
    with pytest.raises(UnknownName, match="efficient"):
        identify_forces("tx40", "none.csv", law="kalman")


def test_logs_without_forces_take_no_law_but_batch(tmp_path):
    with pytest.raises(InvalidInput, match="from forces"):
        command(["identify", "so101", "--law", "memory", "--out", str(tmp_path / "out")])
