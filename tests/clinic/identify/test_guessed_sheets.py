"""A vehicle whose sheet states frame, mass and arm alone is inspected and identified."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import NsaidError
from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.cli.commands import command
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup

ROV = 'kind = "underwater"\nframe = "vectored"\nmass = 11.0\narm = 0.17\n'
OTHER_ROV = """ballast = -1.5
inertia = [0.14, 0.16, 0.25]
added_mass = [3.5, 8.0, 11.0, 0.1, 0.08, 0.12]
linear_drag = [8.0, 20.0, 20.0, 0.2, 0.3, 0.5]
quadratic_drag = [60.0, 250.0, 90.0, 0.5, 0.4, 1.2]

[thrusters]
curve = [15.0, 300.0, -690.0, 665.0, -240.0]
"""
"""What the real one has: 20 to 70 % off the guesses."""
QUADROTOR = 'kind = "quadrotor"\nframe = "x"\nmass = 0.9\narm = 0.2\n'
OTHER_QUADROTOR = """inertia = [0.006, 0.008, 0.012]
body_drag = [0.004, 0.009, 0.02]

[rotors]
thrust = 4.0e-6
torque = 5.0e-8
"""
ANOTHER_CURVE = OTHER_ROV.replace("15.0, 300.0, -690.0, 665.0, -240.0", "18.0, 34.0")
CASES = [
    pytest.param("bluerov2", ROV, OTHER_ROV, 20.0, marks=pytest.mark.slow),
    ("hummingbird", QUADROTOR, OTHER_QUADROTOR, 10.0),
    pytest.param("bluerov2", ROV, ANOTHER_CURVE, 30.0, marks=pytest.mark.slow),
]


def log_of(folder: Path, scenario: str, sheet: str, seconds: float) -> tuple[Path, np.ndarray]:
    """A noisy log of a simulated vehicle with such a sheet, and its true gains."""
    given = load(scenario)
    (folder / "real").mkdir()
    (folder / "real" / "vehicle.toml").write_text(sheet, encoding="utf-8")
    plant = replace(given.plant, vehicle=str(folder / "real"))
    setup = Setup.of(replace(given, plant=plant, duration=seconds, sensors="noisy", seed=5))
    with setup.plant.running():
        log, truth = setup.simulate(), setup.plant.truth
    names = [f"{x}_{k}" for x in "qvu" for k in range(getattr(log, x).shape[1])]
    table = np.column_stack([log.t, log.q, log.v, log.u])
    path = folder / "log.csv"
    header = ",".join(["t", *names])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=header, comments="")
    return path, truth[setup.plant.system.space.actuators]


@pytest.mark.parametrize(("scenario", "stated", "other", "seconds"), CASES)
def test_frame_mass_and_arm_are_enough(tmp_path, monkeypatch, scenario, stated, other, seconds):
    monkeypatch.chdir(tmp_path)
    log, truth = log_of(tmp_path, scenario, stated + other, seconds)
    Path("vehicle.toml").write_text(stated, encoding="utf-8")
    given = [str(log), "--model", "vehicle.toml"]
    assert command(["inspect", *given]) == 0
    assert command(["identify", *given, "--out", "found", "--quiet"]) == 0
    found = json.loads(Path("found/identification.json").read_text(encoding="utf-8"))
    (finding,) = (f for f in found["findings"] if f["code"] == "guessed_sheet")
    assert "inertia = [" in finding["text"] and "positions" not in finding["text"]
    gains = [p for p in found["parameters"] if p["name"].startswith(("thrust_", "torque_"))]
    ratios = np.array([p["value"] for p in gains]) / truth
    same = truth > 0.5 * truth.max()  # thrusts, whose unit is another than the torques'
    assert np.ptp(np.log(ratios[same])) < 0.02
    covered = [p["low"] <= x <= p["high"] for p, x in zip(gains, truth, strict=True)]
    assert all(covered)


@pytest.mark.parametrize("frame", ["x", "+", "betaflight", "vectored", "vectored 6dof"])
@pytest.mark.parametrize(("mass", "arm"), [(0.03, 0.045), (11.0, 0.17), (300.0, 1.2)])
def test_every_size_of_a_frame_is_a_vehicle(tmp_path, frame, mass, arm):
    """A positive thrust lifts, and the rotors' torques cancel at equal commands."""
    path = tmp_path / "own.toml"
    path.write_text(f'frame = "{frame}"\nmass = {mass}\narm = {arm}\n', encoding="utf-8")
    robot = load_robot_model(str(path))
    assert [f.code for f in robot.findings] == ["guessed_sheet"]
    if frame in ("x", "+", "betaflight"):
        rest = np.zeros(2), np.eye(7)[[6, 6]], np.zeros((2, 6)), np.array([[0.0] * 4, [1.0] * 4])
        off, on = robot.system.forces(*rest) @ robot.prior
        force = on - off
        assert force[2] == pytest.approx(3 * 9.81 * mass, rel=0.01)
        assert np.abs(force[3:]).max() < 1e-9 * force[2]


def test_what_is_stated_counts_and_what_is_missing_is_named(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(f"{ROV}volume = 0.0123\n[thrusters]\ncurve = [9.0]\n", encoding="utf-8")
    (finding,) = load_robot_model(str(path)).findings
    assert "volume" not in finding.text and "curve" not in finding.text
    for wrong, said in [
        ('frame = "x"\nmass = 1.0\n', "arm: expected a number > 0"),
        ('frame = "x"\nmass = "heavy"\narm = 0.2\n', "mass: expected a number > 0"),
        ('frame = "vectord"\nmass = 9.0\narm = 0.2\n', "vectored"),
    ]:
        kind = "underwater" if "vec" in wrong else "quadrotor"
        path.write_text(f'kind = "{kind}"\n{wrong}', encoding="utf-8")
        with pytest.raises(NsaidError, match=said):
            load_robot_model(str(path))
    path.write_text('kind = "quadrotor"\nmass = 0.9\n', encoding="utf-8")
    with pytest.raises(InvalidInput, match=r'State frame \("x" or "\+" or "betaflight"\)'):
        load_robot_model(str(path))
