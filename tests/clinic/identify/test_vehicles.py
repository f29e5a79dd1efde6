"""Calibration of a vehicle whose log was recorded with a delay."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup

DELAY = 0.05
AXES = ("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A noisy flight of the hummingbird as CSV, commands logged 50 ms early; its true θ."""
    folder = tmp_path_factory.mktemp("flight")
    setup = Setup.of(replace(load("hummingbird"), duration=15.0, sensors="noisy", seed=3))
    with setup.plant.running():
        log = setup.simulate()
    early = np.searchsorted(log.t, log.t + DELAY - 1e-9).clip(max=len(log.t) - 1)
    rotors = [f"rotor_{i}" for i in range(1, 5)]
    table = np.column_stack([log.t, log.q, log.v, log.u[early]])
    header = ",".join(["time", *AXES, *rotors])
    np.savetxt(folder / "flight.csv", table, delimiter=",", header=header, comments="")
    actuators = "".join(f'"rotor {i}" = {{ column = "rotor_{i}" }}\n' for i in range(1, 5))
    (folder / "map.toml").write_text(
        f"""[vehicle]
position = {list(AXES[:3])}
quaternion = {list(AXES[3:7])}
linear = {list(AXES[7:10])}
angular = {list(AXES[10:])}
[actuators]
{actuators}""",
        encoding="utf-8",
    )
    return folder, setup.plant.truth


def test_a_quadrotors_delay_and_parameters_are_found(flight):
    folder, truth = flight
    found = identify_forces("hummingbird", folder / "flight.csv", mapping=folder / "map.toml")
    assert found.explains == "partly" and "ratios of parameters hold" in found.verdict
    assert not [p.name for p in found.parameters if p.status == "identified"]
    assert found.joints[0].delay == pytest.approx(DELAY, abs=0.005)
    values = np.array([p.value for p in found.parameters[: len(truth)]])
    thrusts = [i for i, p in enumerate(found.parameters) if p.name.startswith("thrust")]
    scale = np.mean(values[thrusts] / truth[thrusts])
    named = {
        p.name: p.value / scale / truth[i]
        for i, p in enumerate(found.parameters[:24])
        if truth[i] != 0
    }
    for name in (
        "m",
        "Ixx",
        "Iyy",
        "Izz",
        *(f"thrust_{i}" for i in range(1, 5)),
        *(f"torque_{i}" for i in range(1, 5)),
    ):
        assert named[name] == pytest.approx(1.0, rel=0.02), name


@pytest.mark.slow
def test_a_weighed_quadrotor_has_a_scale(flight):
    folder, truth = flight
    found = identify_forces(
        "hummingbird",
        folder / "flight.csv",
        mapping=folder / "map.toml",
        known={"m": float(truth[0])},
    )
    assert found.explains == "yes"
    for thrust, true in zip(found.parameters[16:20], truth[16:20], strict=True):
        assert thrust.status == "identified" and thrust.low <= true <= thrust.high
        assert thrust.value == pytest.approx(true, rel=0.02)


def test_a_thruster_with_a_dead_zone_is_told(tmp_path):
    setup = Setup.of(replace(load("bluerov2"), duration=10.0, sensors="noisy", seed=3))
    with setup.plant.running():
        log = setup.simulate()
    u = log.u + 0.05 * np.sign(log.u) * np.sqrt(np.mean(log.u**2, axis=0))
    parts = zip("qvu", (log.q, log.v, u), strict=True)
    names = [f"{name}_{k}" for name, part in parts for k in range(part.shape[1])]
    table = np.column_stack([log.t, log.q, log.v, u])
    header = ",".join(["t", *names])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="")
    found = identify_forces("bluerov2", tmp_path / "log.csv")
    told = [f.text for f in found.findings if f.code == "residuals" and "thruster" in f.where]
    assert any("of its force" in text for text in told)
