"""The compiled simulation loop gives the same log as asking the driver at every step."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nsaid_mj.core.log import Log
from nsaid_mj.lab.control.driver import Driver, DriverConfig
from nsaid_mj.lab.control.multisine import MultisineCommand
from nsaid_mj.lab.control.signals import FourierTrajectory, Multisine
from nsaid_mj.lab.control.tracking import FourierTracking
from nsaid_mj.lab.plants.jointed import ArmPlant, FloatingBasePlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant, F1TenthPlant
from nsaid_mj.lab.plants.world import plant as plants
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.faults.kinds import Loss
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.plants.world.sensors import Sensors
from nsaid_mj.robots.errors import BadRobot

TRACKING, SINES = FourierTracking(), MultisineCommand(amplitude=0.3)
CASES: dict[str, tuple[PlantConfig, DriverConfig]] = {
    "ur5": (ArmPlant("ur5"), TRACKING),
    "ur5, pinocchio": (ArmPlant("ur5", backend="pinocchio"), TRACKING),
    "xarm7, no rotors": (ArmPlant("xarm7", armature=0.0), TRACKING),
    "kinova, joints that turn on": (ArmPlant("kinova"), TRACKING),
    "kinova, open loop": (ArmPlant("kinova"), SINES),
    "solo12, afloat": (FloatingBasePlant("solo12"), SINES),
    "bluerov2": (BlueROV2Plant(), SINES),
    "bluerov2, in MuJoCo's water": (
        BlueROV2Plant(mismatch=Mismatch(lag=0.1, flow=(0.2, 0.1, 0.0), fluid="ellipsoid")),
        SINES,
    ),
    "f1tenth, in the plane": (F1TenthPlant(), SINES),
    "scalar_rov": (ScalarRovPlant(), SINES),
}
every_case = pytest.mark.parametrize("case", CASES)
NOISE = {
    "exact": None,
    "noisy": SensorNoise(),
    "coarse": SensorNoise(position=1e-3, encoder_step=2e-3),
}
DT, STEPS = 1e-3, 500


class Interpreted(Driver):
    """A driver's own commands, without the compiled form of its law."""

    def __init__(self, driver: Driver):
        self._driver = driver

    def start(self):
        return self._driver.start()

    def command(self, t, q, v):
        return self._driver.command(t, q, v)


def made(case: str) -> tuple[Plant, Driver]:
    config, excitation = CASES[case]
    p = config.build(DT, 7)
    prior = p.truth * (1 + 0.1 * np.random.default_rng(1).uniform(-1, 1, p.system.p))
    return p, excitation.build(p.system, prior, np.random.default_rng(2))


def driven(
    p: Plant,
    driver: Driver,
    noise: SensorNoise | None = None,
    stretches: tuple[int, ...] = (STEPS,),
) -> Log:
    sensors = Sensors(noise, np.random.default_rng(3))
    with p.running():
        rows = [p.begin(driver, sensors)]
        for steps in stretches:
            rows += p.drive(driver, rows[-1], steps, sensors).rows[1:]
    return Log.unchecked_of(rows)  # the last of a plant that diverges is not finite


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many stretches went through compiled code; none may fall back unseen."""
    stretches: list[int] = []

    def counted(*arguments, real=plants.drive):
        stretches.append(real(*arguments))
        return stretches[-1]

    monkeypatch.setattr(plants, "drive", counted)
    return stretches


def same(one: Log, other: Log, bar: float = 0.0) -> None:
    for a, b in zip(one, other, strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=bar, atol=bar * np.abs(b).max(initial=0))


@every_case
@pytest.mark.parametrize("noise", NOISE)
def test_the_compiled_drive_measures_and_commands_as_the_loop_does(case, noise, compiled):
    p, driver = made(case)
    fast = driven(p, driver, NOISE[noise])
    assert compiled == [STEPS + 1]
    slow = driven(p, Interpreted(driver), NOISE[noise])
    assert len(compiled) == 1 and len(slow.t) == STEPS + 1
    assert np.ptp(slow.q, axis=0).max() > 1e-3, "nothing moved"
    same(fast, slow, 1e-9)
    if noise != "exact":  # the noise is there, and the same stream
        exact = driven(p, driver)
        assert np.abs(fast.v - exact.v).std() > 1e-3


@every_case
def test_driving_in_stretches_gives_the_same_bits(case, compiled):
    p, driver = made(case)
    whole = driven(p, driver, SensorNoise())
    same(driven(p, driver, SensorNoise(), (250, 1, 249)), whole)
    same(driven(*made(case), SensorNoise()), whole)
    assert compiled == [501, 251, 2, 250, 501]


@pytest.mark.parametrize("robot", ["ur5", "xarm7", "kinova", "panda", "double_pendulum", "baxter"])
@pytest.mark.parametrize("armature", [None, 0.0])
def test_the_computed_torque_equals_that_of_pinocchios_regressor(robot, armature):
    """u = K̂₀⁻¹ [W_M(a) + W_C(v) − F(u = 0)] θ̂₀, for any θ̂₀."""
    try:
        p = ArmPlant(robot, armature=armature, backend="pinocchio").build(DT, 0)
    except BadRobot as error:
        pytest.skip(str(error))
    system, rng = p.system, np.random.default_rng(5)
    assert system.reference is not None
    prior = system.space.scale * rng.uniform(0.1, 2, system.p) * rng.choice([-1, 1], system.p)
    driver = FourierTracking(bandwidth=1.5, limit=1e12).build(system, prior, rng)
    path, omega = driver.desired, 2 * np.pi * 1.5
    for t in rng.uniform(0, 20, 5):
        q, v, _ = system.random_state(rng)
        wanted, speed, a = path(t)
        a = a + 2 * omega * (speed - v)
        a = a + omega**2 * system.difference(q, system.position(wanted))
        x, still = np.concatenate([q, v]), np.zeros(system.n)
        W = system.W_M(x, a) + system.W_C(x, v) - system.F(t, x, still)
        gain = prior[system.space["motor gain"]]
        size = np.abs(W) @ np.abs(prior) / np.abs(gain)
        assert (np.abs(driver.command(t, q, v) - W @ prior / gain) <= 1e-12 * size.max()).all()


def test_a_series_is_the_sum_of_its_harmonics():
    rng = np.random.default_rng(0)
    low, high = rng.uniform(-2, -1, 4), rng.uniform(1, 2, 4)
    path = FourierTrajectory(low, high, np.full(4, 3.0), 0.3, 7, rng)
    for t in (0.0, 0.123, 17.0):
        omega, coefficients, centre = path.series
        k = 1j * omega
        terms = (coefficients[:, 7:] - 1j * coefficients[:, :7]) * np.exp(k * t)
        expected = [
            centre + terms.sum(1).real,
            (k * terms).sum(1).real,
            (k * k * terms).sum(1).real,
        ]
        np.testing.assert_allclose(path(t), expected, rtol=1e-13, atol=1e-12)


def test_a_multisine_of_many_times_equals_that_of_each():
    signal = Multisine(5, 0.1, 2.0, 9, 0.7, np.random.default_rng(0))
    t = np.arange(1000) * DT
    many = signal(t)
    assert (many == [signal(float(now)) for now in t]).all()
    assert many.shape == (1000, 5) and np.ptp(many) > 0.7


# -- when it ends early ----------------------------------------------------------------------------


def ended(p: Plant, driver: Driver, noise=None) -> tuple[Log, str]:
    log = driven(p, driver, noise)
    return log, p.diverged


DIVERGENT = {
    "commands that throw a vehicle away": ("scalar_rov", 5e9, "qpos"),
    "commands beyond what MuJoCo takes": ("scalar_rov", 1e12, "ctrl"),
    "commands that throw a body away": ("bluerov2", 1e4, "qacc"),
    "commands that throw an arm away": ("kinova, open loop", 1e9, "qacc"),
}


@pytest.mark.parametrize("name", DIVERGENT)
def test_the_compiled_drive_ends_where_the_loop_does_for_the_same_reason(name, compiled):
    case, amplitude, signal = DIVERGENT[name]
    config, _ = CASES[case]
    p = config.build(DT, 7)
    driver = MultisineCommand(amplitude=amplitude, high=5.0).build(
        p.system, p.truth, np.random.default_rng(2)
    )
    fast, why = ended(p, driver)
    assert compiled == [len(fast.t)]
    slow, expected = ended(p, Interpreted(driver))
    assert why == expected == signal
    assert 1 < len(fast.t) == len(slow.t) < STEPS
    for part in fast.first(len(fast.t) - 1):
        assert np.isfinite(part).all()


class Spoilt:
    """A source of errors whose `at`-th number is no error, and is told by no one."""

    def __init__(self, at: int, value: float):
        self._left, self._value, self._rng = at, value, np.random.default_rng(0)

    def standard_normal(self, shape):
        errors = self._rng.standard_normal(shape)
        if 0 <= self._left < errors.size:
            errors.flat[self._left] = self._value
        self._left -= errors.size
        return errors


@pytest.mark.parametrize("case", ["ur5", "bluerov2", "scalar_rov"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("row", [1, 120, STEPS])
@pytest.mark.parametrize("signal", [0, 1])
def test_driving_stops_at_the_first_nonfinite_measurement(case, value, row, signal, compiled):
    p, driver = made(case)
    at = (2 * row + signal) * p.system.n
    logs = []
    for asked in (driver, Interpreted(driver)):
        sensors: Any = Sensors(SensorNoise(), Spoilt(at, value))  # type: ignore[arg-type]
        with p.running(), np.errstate(invalid="ignore"):
            logs.append(p.drive(asked, p.begin(asked, sensors), STEPS, sensors))
        assert p.diverged == ""
        parts = np.column_stack(logs[-1])
        assert len(parts) == row + 1
        assert np.isfinite(parts[:-1]).all() and not np.isfinite(parts[-1]).all()
    assert compiled == [row + 1]
    fast, slow = (log.first(row) for log in logs)
    same(fast, slow, 1e-9)


# -- when the driver must be asked -----------------------------------------------------------------


def test_delays_and_faults_are_driven_step_by_step(compiled):
    config, excitation = CASES["bluerov2"]
    late = replace(config, mismatch=Mismatch(delay=3 * DT)).build(DT, 7)
    driver = excitation.build(late.system, late.truth, np.random.default_rng(2))
    driven(late, driver)
    assert not compiled
    failing = replace(config, faults=(Loss(share=0.5, time=0.3),)).build(DT, 7)
    log = driven(failing, driver, None, (200, 200, 100))
    assert compiled == [201, 101]
    same(log, driven(failing, Interpreted(driver), None, (200, 200, 100)), 1e-12)
    sound = driven(config.build(DT, 7), driver)
    assert (log.v[:301] == sound.v[:301]).all() and (log.v[301] != sound.v[301]).any()


def test_another_process_finds_the_loops_on_disk():
    """No address is compiled in: what one process compiled serves the next."""
    for case in ("ur5", "bluerov2"):
        driven(*made(case))
    code = """
from nsaid_mj.base import Stopwatch
watch = Stopwatch()
from tests.lab.plants.test_drive import driven, made
for case in ("ur5", "bluerov2"):
    driven(*made(case))
assert watch.compiling == 0.0
"""
    root = Path(__file__).parents[3]
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120, cwd=root)
