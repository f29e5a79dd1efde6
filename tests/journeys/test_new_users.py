"""First paths of new users: the commands of the docs, word for word, and what they lead to.

Seven users: here the student with the paper, an ROV's engineer with pulse widths, the owner of a
robot with legs, and a reviewer. The owner of an arm with currents and the lead engineer with a
typed script are in tests/test_readme.py (`test_the_newcomers_path_leads_to_a_calibrated_robot`)
and tests/test_types.py, of an arm of position servos in tests/cli/test_servos.py
(`test_three_commands_lead_from_a_lerobot_dataset_to_a_calibrated_file`), of a quadrotor with a ULog
in tests/clinic/identify/test_flight.py (`test_two_commands_lead_from_a_px4_log_to_thrust_ratios`),
and of a robot of MuJoCo Menagerie in tests/clinic/servos/test_menagerie.py.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from nsaid_mj import theta_bar
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from nsaid_mj.report import ExitCode
from tests.clinic.identify.ground.walking import GAINS, walked
from tests.support.faulty import CHECKOUT, Heard, shell, strict


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's empty folder, in which commands are given."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def give(page: str, words: str) -> tuple[int, Heard]:
    """Gives a command that a page shows, in a block of its own line or amid a text."""
    text = (CHECKOUT / page).read_text(encoding="utf-8")
    shown = re.findall(r"^(nsaid [^#\n]*?) *(?:#.*)?$|`(nsaid [^`]*)`", text, re.MULTILINE)
    assert words in {line or code for line, code in shown}, f"{page} does not show: {words}"
    return shell(*shlex.split(words)[1:])


def test_a_reader_of_the_paper_checks_its_theorems_on_a_run(folder: Path):
    code, said = give("docs/usage.md", "nsaid verify scalar_rov --out runs/verified")
    assert code == ExitCode.EXPLAINED
    for statement in ("Theorem 1 (70)", "Lemma 1 (74)", "Theorem 2", "(30) in (45)"):
        assert statement in said.out
    found = strict((folder / "runs/verified/verify.json").read_text(encoding="utf-8"))
    assert {each["verdict"] for each in found["statements"]} == {"holds"}
    bar = theta_bar(folder / "runs/verified")  # docs/record.md: for a figure of one's own
    first, last = np.linalg.norm(bar.perp, axis=1)[[0, -1]]
    assert last < 0.05 * first and np.linalg.norm(bar.P[-1]) > 0.5


def test_an_rov_engineer_finds_a_thruster_that_loses_thrust(folder: Path):
    command = 'nsaid run bluerov2 --law efficient --faults "loss 0.4 of 3 at 20 s"'
    code, said = give("README.md", command)
    assert code == ExitCode.EXPLAINED
    assert re.search(r"fault found at 20\.\d s: thrust of thruster 3 lost 40 %", said.out)
    summary = strict((folder / "runs/bluerov2-efficient/summary.json").read_text("utf-8"))
    assert summary["actuator_ratio_error"] < 1e-6


@pytest.mark.slow
def test_the_fault_that_the_docs_show_is_what_a_run_prints(folder: Path):
    text = (CHECKOUT / "docs/faults.md").read_text(encoding="utf-8")
    command, _, shown = text.partition("$ nsaid ")[2].partition("```")[0].partition("\n")
    _, said = shell(*shlex.split(command))
    assert all(line in said.out.splitlines() for line in shown.splitlines() if line)


def test_a_reviewer_finds_an_unmodelled_lag_contradicted(folder: Path):
    command = "run bluerov2 --law efficient --sensors noisy --duration 20"
    code, said = give("docs/results.md", f"nsaid {command} --plant.mismatch.lag 0.05")
    assert code == ExitCode.NOT_EXPLAINED
    assert "✘ bluerov2: the motion contradicts this structure" in said.out
    assert shell(*command.split(), "--quiet")[0] == ExitCode.EXPLAINED  # without the lag


def following(said: Heard) -> list[str]:
    """The arguments of the command that `inspect` proposes."""
    (line,) = [line for line in said.out.splitlines() if line.startswith("  Next: ")]
    return shlex.split(line.rpartition("nsaid ")[2])


ROV = """kind = "underwater"
frame = "vectored 6dof"
mass = 13.5
arm = 0.19
"""
"""All that the engineer knows, see docs/your_vehicle.md."""


def dive(seconds: float) -> tuple[str, np.ndarray]:
    """A BlueROV2's log of pulse widths and Euler angles, and its true thrusts in ArduSub's order.

    Its motors turn the other way than ArduSub's frame says.
    """
    setup = Setup.of(replace(load("bluerov2"), duration=seconds, sensors="noisy", seed=8))
    with setup.plant.running():
        log, truth = setup.simulate(), setup.plant.truth
    angles = Rotation.from_quat(log.q[:, 3:]).as_euler("ZYX", degrees=True)[:, ::-1]
    pulses = np.round(1500 + 500 * log.u)
    table = np.column_stack([log.t, log.q[:, :3], angles, log.v, pulses])
    head = "time,x,y,z,roll_deg,pitch_deg,yaw_deg,u,v,w,p,q,r,"
    head += ",".join(f"pwm_{k}" for k in range(1, 9))
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in table)
    return f"{head}\n{rows}\n", truth[setup.plant.system.space.actuators]


def test_an_rov_engineer_with_pulse_widths_gets_thrusts(folder: Path):
    """Frame, mass and arm length are known; inspect says what to do until identify can be given."""
    text, truth = dive(12.0)
    Path("dive.csv").write_text(text, encoding="utf-8")
    Path("rov.toml").write_text(ROV, encoding="utf-8")
    code, said = shell("inspect", "dive.csv", "--model", "rov.toml")
    assert code == ExitCode.UNUSABLE and "euler (roll_deg, pitch_deg, yaw_deg)" in said.out
    code, said = shell(*following(said), "--fix")  # the first map was complete
    assert code == ExitCode.EXPLAINED and "before: all commands are reversed" in said.out
    assert "after: no contradiction is left" in said.out
    code, said = shell(*following(said), "--known", "m=13.5", "--out", "found")
    assert code == ExitCode.EXPLAINED
    found = yaml.safe_load(Path("found/calibrated.yaml").read_text(encoding="utf-8"))
    thrusts = [p["value"] for p in found["parameters"] if p["name"].startswith("thrust of")]
    assert np.ptp(np.log(np.array(thrusts) / truth)) < 0.03


def test_a_robot_on_its_feet_gets_a_calibrated_mjcf(folder: Path):
    """Joints, currents and IMU; the weight is known, the forces on the feet are not."""
    given = walked(folder)
    code, said = shell("inspect", given.log.name, "--model", given.model.name)
    assert code == ExitCode.EXPLAINED
    code, said = shell(*following(said), "--known", f"mass={given.mass}", "--out", "found")
    assert code == ExitCode.EXPLAINED
    identified = strict(Path("found/identification.json").read_text(encoding="utf-8"))
    gains = [p for p in identified["parameters"] if p["name"].startswith("gain_")]
    assert all(p["low"] < g < p["high"] for p, g in zip(gains, GAINS, strict=True))
    assert "stance" in {finding["code"] for finding in identified["findings"]}
    model = mujoco.MjModel.from_xml_path(str(folder / "found" / given.model.name))
    ratio = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0] / GAINS
    assert np.log(ratio).std() < 0.01
    assert abs(ratio.mean() - 1) < 0.02  # its feet never leave the ground: their mass is the file's
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert np.isfinite(data.qpos).all()
