"""Substeps: MuJoCo integrates finer than the measurements are taken, under held commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.core.parameters import Array
from nsaid_mj.lab import loop as experiment
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant, F1TenthPlant
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.faults.kinds import Loss
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.record import RECORD_FILE
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.lab.setup import Setup
from nsaid_mj.plans.studies import montecarlo
from tests.lab.plants.test_drive import CASES, Interpreted, driven, same
from tests.support.plants import config_of, hold, name_of, path, random_commands, start_of
from tests.support.vehicles import INEXACT, VEHICLES

DT, FINER = 4e-3, 4
ANY = [ArmPlant("double_pendulum"), ArmPlant("ur5"), ScalarRovPlant(), *VEHICLES.values()]
RUN = {"duration": 0.4, "held_out": 0.2, "pe_window": 0.1}


def assert_equal_to_finer_steps(config: PlantConfig) -> None:
    coarse = config.build(DT, 4).refined(FINER)
    fine = config.build(DT / FINER, 4)
    commands, start = random_commands(coarse, 30), start_of(coarse)
    expected = path(fine, np.repeat(commands, FINER, axis=0), *start)
    assert (path(coarse, commands, *start) == expected[::FINER]).all()
    assert coarse.dt == DT and (coarse.truth == fine.truth).all()


@pytest.mark.parametrize("config", ANY, ids=name_of)
def test_substeps_are_steps_of_a_finer_simulation_under_held_commands(config):
    assert_equal_to_finer_steps(config)


@pytest.mark.parametrize(
    "mismatch",
    [{"lag": 0.02}, {"delay": 3 * DT}, {"flow": (0.4, -0.3, 0.2)}, {"fluid": "ellipsoid"}],
)
def test_a_mismatch_is_the_same_effect_at_any_number_of_substeps(mismatch):
    assert_equal_to_finer_steps(BlueROV2Plant(mismatch=Mismatch(**mismatch)))


@pytest.mark.parametrize("name", ["double_pendulum", "bluerov2", "astrobee"])
def test_a_fault_occurs_at_the_same_time_with_substeps(name):
    config = replace(config_of(name), faults=(Loss(share=0.5, time=15 * DT),))
    assert_equal_to_finer_steps(config)
    t = DT * np.arange(31)
    epoch = config.build(DT, 4).refined(FINER).epoch(t)
    assert (epoch == config.build(DT, 4).epoch(t)).all() and set(epoch) == {0, 1}


@pytest.mark.parametrize("name", INEXACT)
def test_a_plant_in_contact_takes_substeps(name):
    coarse = config_of(name).build(DT, 4)
    start, commands = start_of(coarse), random_commands(coarse, 30)
    before = path(coarse, commands, *start)
    after = path(coarse.refined(FINER), commands, *start)
    moved = np.abs(before - before[0]).max()
    assert 0 < np.abs(after - before).max() < 0.05 * moved


@pytest.mark.parametrize("case", ["ur5", "kinova, open loop", "bluerov2", "scalar_rov"])
@pytest.mark.parametrize("noise", [None, SensorNoise()])
def test_the_compiled_drive_takes_the_substeps_of_the_loop(case, noise):
    config, excitation = CASES[case]
    logs = []
    for substeps in (1, FINER):
        p = config.build(DT, 7).refined(substeps)
        prior = p.truth * (1 + 0.1 * np.random.default_rng(1).uniform(-1, 1, p.system.p))
        driver = excitation.build(p.system, prior, np.random.default_rng(2))
        logs.append(driven(p, driver, noise))
        same(logs[-1], driven(p, Interpreted(driver), noise), 1e-9)
        calls = p.data.time / p.model.opt.timestep  # of mj_step, which is what it costs
        assert calls == pytest.approx(substeps * (len(logs[-1].t) - 1))
    assert (logs[0].t == logs[1].t).all() and (logs[0].v != logs[1].v).any()


@pytest.mark.parametrize(
    "config",
    [ScalarRovPlant(), ArmPlant("double_pendulum", friction_speed=0.5), F1TenthPlant()],
    ids=name_of,
)
def test_the_motion_converges_with_the_substeps_to_fourth_order(config):
    def end(substeps: int) -> Array:
        p = config.build(4e-3, 5).refined(substeps)
        u = 0.3 * p.system.random_state(np.random.default_rng(0))[2]
        start = np.full(p.system.n, 0.5), np.full(p.system.n, 1.0)
        return hold(p, start, u, 0.32)

    exact = end(32)
    errors = [np.abs(end(substeps) - exact).max() for substeps in (1, 2, 4)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 3.5).all() and (orders < 5).all(), (errors, orders)


# -- a run ---------------------------------------------------------------------------------------


def recorded(scenario: Scenario, folder) -> experiment.SimulatedRun:
    return experiment.run(replace(scenario, **RUN), folder)


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum", "bluerov2"])
def test_substeps_change_the_motion_by_the_integrators_error_only(name, tmp_path):
    scenario = load(name)
    one, four = (recorded(replace(scenario, substeps=k), tmp_path / str(k)) for k in (1, FINER))
    assert (one.prior == four.prior).all() and (one.plant.truth == four.plant.truth).all()
    assert (one.record["t"] == four.record["t"]).all()
    moved = np.ptp(one.record["v"], axis=0).max()
    difference = np.abs(one.record["v"] - four.record["v"]).max()
    assert 0 < difference < 1e-3 * moved
    held_out = [run.setup.held_out(0.0) for run in (one, four)]
    assert held_out[0] is not None and held_out[1] is not None
    assert (held_out[0].v != held_out[1].v).any()


def test_a_run_with_substeps_is_reproduced_from_its_record(tmp_path):
    scenario = replace(load("scalar_rov"), substeps=3, sensors="noisy")
    first = recorded(scenario, tmp_path / "first")
    again = experiment.reopen(tmp_path / "first", first.record).scenario
    assert again.substeps == 3
    experiment.run(again, tmp_path / "again")
    assert (tmp_path / "first" / RECORD_FILE).read_bytes() == (
        tmp_path / "again" / RECORD_FILE
    ).read_bytes()


def test_a_monte_carlo_study_simulates_its_plants_with_substeps():
    scenario = replace(load("scalar_rov"), substeps=FINER, **RUN)
    pool = montecarlo.ThreadPoolExecutor(1)
    (course,) = montecarlo.simulate([scenario], pool)
    setup = Setup.of(scenario)
    with setup.plant.running():
        expected = setup.simulate()
    assert (course.log.v == expected.v).all()
    (coarse,) = montecarlo.simulate([replace(scenario, substeps=1)], pool)
    assert (course.log.v != coarse.log.v).any()
