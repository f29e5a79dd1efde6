"""The recording of identified servos holds targets, positions, windows left out, and the robot."""

import subprocess

import numpy as np
import pytest

from nsaid_mj.clinic.identify.recording import record_servos
from nsaid_mj.clinic.servos.logs import ServoLog
from nsaid_mj.clinic.servos.page import servo_page
from nsaid_mj.clinic.servos.result import Replayed
from nsaid_mj.lab.recording import viewer
from tests.support.recordings import entities_of
from tests.support.servos import NAMES, identified_servos

ARM = """<mujoco model="arm"><worldbody>
<body><joint name="lift" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
<body pos=".3 0 0"><joint name="elbow" axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/></body></body></worldbody>
<actuator><position joint="lift" kp="10"/><position joint="elbow" kp="10"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """File and what it was made of: two logs, of which the second has a window left out."""
    folder = tmp_path_factory.mktemp("recording")
    (folder / "arm.xml").write_text(ARM)
    t = np.arange(200) / 50
    q = np.column_stack([np.sin(t), np.cos(t)])
    mass = np.zeros((*q.shape, q.shape[1]))
    logs = tuple(ServoLog(name, t, q + 0.1, q + 0.1, q, 0 * q, mass) for name in ("a.csv", "b.csv"))
    used = np.r_[np.ones(250), np.zeros(100), np.ones(50)]
    replayed = Replayed(logs, (q + 0.01, q - 0.01), used)
    found = identified_servos(used, folder / "arm.xml")
    return record_servos(servo_page(found, replay=replayed), replayed, folder / "run.rrd"), replayed


def values(entities, entity):
    """(N,) of a curve."""
    rows = entities[entity]["Scalars:scalars"]
    return np.array([row[0] for row in rows if row is not None])


def test_curves_are_those_of_the_logs_and_their_replay(recorded):
    file, replayed = recorded
    entities = entities_of(file)
    for j, name in enumerate(NAMES):
        position = np.concatenate([log.position[:, j] for log in replayed.logs])
        simulated = np.concatenate([q[:, j] for q in replayed.simulated])
        for part, wanted in (
            ("command", position + 0.1),
            ("measured", position),
            ("simulated", simulated),
        ):
            shown = values(entities, f"/position/{name}/{part}")
            np.testing.assert_allclose(shown[np.isfinite(shown)], wanted)
            assert np.isnan(shown).sum() == 1  # the line is interrupted between the two logs
        residual = values(entities, f"/residual/{name}")
        assert np.nanmax(np.abs(residual)) == pytest.approx(0.01)  # rad


def test_windows_left_out_are_curves_of_their_own(recorded):
    file, replayed = recorded
    shown = values(entities_of(file), "/position/elbow/measured_unused")
    position = np.concatenate([log.position[:, 1] for log in replayed.logs])
    np.testing.assert_allclose(shown[np.isfinite(shown)], position[250:350])


def test_the_arm_moves_as_measured_and_intervals_are_told_by_joint(recorded):
    entities = entities_of(recorded[0])
    lengths = [len(moved["sim_time"]) for k, moved in entities.items() if k.startswith("/robot/0")]
    assert len(lengths) == 2 and min(lengths) > 100
    (text,) = entities["/parameters"]["TextDocument:text"][0]
    for name in NAMES:
        assert f"### {name}" in text and f"stiffness kp of {name}" in text
    assert "95 % interval" in text and "prior" not in text
    assert "explains the motion" in entities["/result"]["TextDocument:text"][0][0]


def test_rerun_accepts_the_file(recorded):
    words = [*viewer.program(), "rrd", "verify", str(recorded[0])]
    assert subprocess.run(words, check=False).returncode == 0
