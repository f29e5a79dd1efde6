"""Every kind of fault acts in MuJoCo as the truth says, and reads back from its text."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, NsaidError
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant, QuadrotorPlant
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.faults.kinds import Fault, Loss, Payload
from nsaid_mj.lab.plants.world.faults.text import fault_text, parse_faults
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.scenario import Scenario
from tests.support.plants import drive, path, random_commands, start_of
from tests.support.vehicles import INEXACT, VEHICLES, acceleration, draw_numbers

ARM, ROV, FLYER = ArmPlant("double_pendulum"), BlueROV2Plant(), QuadrotorPlant(vehicle="crazyflie")
DT = 2e-3


def made(config: PlantConfig, text: str | tuple[Fault, ...]) -> Plant:
    return replace(config, faults=parse_faults(text) if isinstance(text, str) else text).build(
        DT, 4
    )


@pytest.mark.parametrize(
    ("config", "text", "changed"),
    [
        (ARM, "loss 0.25 of 2", {"gain_2"}),
        (ARM, "reversed 1", {"gain_1"}),
        (FLYER, "broken 3", {"thrust_3", "torque_3"}),
        (VEHICLES["remus100"], "broken 3", {"fin lift_3", "fin drag_3"}),
        (ARM, "friction 0.3 of viscous_1; friction 2e-3 of coulomb_2", {"viscous_1", "coulomb_2"}),
        (ROV, "friction 40 of d_sway", {"d_sway"}),
        (FLYER, "friction 0.01 of drag_x", {"drag_x"}),
        (ARM, "payload 0.5 kg place 0 0.1 0.2 on link 2", None),
        (ROV, "payload 2 kg place 0.1 0 -0.2", None),
        (FLYER, "payload 5e-3 kg place 0.01 0 -0.02", None),
        (VEHICLES["uvms"], "payload 0.2 kg place 0 0 0.05; loss 0.3 of 6", None),
        (VEHICLES["astrobee"], "payload 1 kg place 0.1 0 0", None),
    ],
)
def test_mujoco_accelerates_as_the_structure_does_under_the_truth_of_the_time(
    config, text, changed
):
    p, rng = made(config, "; ".join(f"{part} at 1 s until 2 s" for part in text.split(";"))), 3
    thetas = p.truth_at([0.5, 1.5, 2.5])
    assert (thetas[0] == p.truth).all() and (thetas[2] == p.truth).all()
    differ = np.flatnonzero(thetas[1] != thetas[0])
    assert len(differ) and (changed is None or {p.system.space.names[i] for i in differ} == changed)
    _, v, u = p.system.random_state(np.random.default_rng(rng))
    numbers = draw_numbers(p.system, np.random.default_rng(rng))
    x = np.concatenate([p.position(numbers), v])
    for t, theta in zip((0.5, 1.5, 2.5), thetas, strict=True):
        expected = p.system.acceleration(0.0, x, v, u, theta)
        found = acceleration(p, numbers, v, u, t)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("config", [ARM, ROV, FLYER])
def test_a_payload_that_is_released_leaves_the_plant_as_before(config):
    """Only the state remembers it; a run without it is the sound plant's to the bit."""
    p = made(config, (Payload(0.02, (0.01, 0.0, 0.0), time=20 * DT, until=40 * DT),))
    sound = made(config, "")
    u, at = random_commands(p), start_of(p)
    rows, expected = path(p, u, *at), path(sound, u, *at)
    assert (rows[:21] == expected[:21]).all()
    assert (rows[21:] != expected[21:]).any(axis=1).all()
    assert (path(p, u, *at) == rows).all()
    again = path(sound, u[40:], rows[40, : p.system.n], rows[40, p.system.n :])
    np.testing.assert_allclose(rows[40:], again, rtol=1e-9, atol=1e-9)


def test_a_stuck_actuator_holds_its_last_command_or_a_given_one():
    u = random_commands(made(ARM, ""))
    for text, value in (("stuck 1", u[19, 0]), ("stuck 1 holding 0.3", 0.3)):
        p, sound = made(ARM, f"{text} at {20 * DT} s"), made(ARM, "")
        held = u.copy()
        held[20:, 0] = value
        assert (path(p, u, *start_of(p)) == path(sound, held, *start_of(sound))).all()
        assert p.truth_at(1.0)[p.system.space.index("gain_1")] == 0


def test_a_slow_loss_takes_its_rate_and_stops_at_its_share():
    p = made(ARM, "loss 10 % of 2 rate 1 %/s at 5 s")
    k = p.system.space.index("gain_2")
    ratio = p.truth_at([4.0, 6.0, 10.0, 30.0])[:, k] / p.truth[k]
    np.testing.assert_allclose(ratio, [1.0, 0.99, 0.95, 0.9], atol=1e-4)
    assert p.epoch([4.0, 15.5])[1] > p.epoch([5.5])[0] > p.epoch([4.0])[0] == 0
    fast = made(ARM, (Loss(0.5, rate=10.0, actuator=2, time=0.0),))
    u, at = random_commands(fast), start_of(fast)
    rows = path(fast, u, *at)
    rate = np.diff(rows[:, 2:], axis=0) / DT
    theta = fast.truth_at(DT * np.arange(len(rate)))
    mean = [
        fast.system.acceleration(0.0, np.r_[fast.position(row[:2]), row[2:]], row[2:], c, th)
        for row, c, th in zip(rows[:-1], u, theta, strict=False)
    ]
    assert np.abs(rate - mean).max() < 0.2 * np.abs(rate).max()


def test_a_biased_sensor_leaves_the_motion_alone():
    p, sound = made(ROV, "bias 0.05 of position 2 at 0.1 s; bias -0.2 of velocity 1"), made(ROV, "")

    def driver(p: Plant) -> Driver:
        return load("bluerov2").excitation.build(p.system, p.truth, np.random.default_rng(1))

    biased, plain = (drive(one, driver(one), 0.2) for one in (p, sound))
    late = biased.t > 0.1
    np.testing.assert_allclose(biased.v[1:, 0], plain.v[1:, 0] - 0.2, atol=1e-12)
    np.testing.assert_allclose(biased.q[late, 1], plain.q[late, 1] + 0.05, atol=1e-12)
    assert (biased.q[~late] == plain.q[~late]).all() and (p.truth_at(9.0) == p.truth).all()


# -- as text ---------------------------------------------------------------------------------------

TEXTS = [
    "loss 0.4 of 3 at 12.0",
    "loss 0.1 of 2 rate 0.01 at 5.0",
    "stuck 2 holding 0.3 at 5.0; broken 1; reversed 2 until 3.0",
    "payload 1.0 place 0.0 0.0 0.1 on link 6 at 10.0 until 15.0",
    "friction 1.5 of viscous_3; bias -0.05 of velocity 1 at 2.0",
]


@pytest.mark.parametrize("text", TEXTS)
def test_faults_read_back_from_their_text_and_from_json(text):
    faults = parse_faults(text)
    assert parse_faults("; ".join(map(fault_text, faults))) == faults
    scenario = Scenario(plant=replace(ROV, faults=text))
    assert scenario.plant.faults == faults
    assert Scenario.from_json(scenario.to_json()) == scenario


def test_units_are_optional_and_per_cent_divides():
    assert parse_faults("loss 40 % of 3 at 12 s") == parse_faults("loss 0.4 of 3 at 12")
    assert parse_faults("loss 40% of 3 rate 1%/s") == parse_faults("loss .4 of 3 rate 0.01")


@pytest.mark.parametrize(
    "text",
    [
        "explode 2",
        "loss of",
        "loss 0.4 of 2.5",
        "loss 2 of 1",
        "loss 0.4 kg of 2",
        "loss 0.4 of 2 at noon",
        "loss 0.4 of 2 of 3",
        "loss 0.4 0.3 of 2",
        "loss nan of 2",
        "stuck 1 at 5 s until 4 s",
        "payload -1",
        "payload 1 place 0 0",
        "bias 0.1 of position",
        "bias 0.1 of colour 2",
    ],
)
def test_a_text_that_is_no_fault_is_refused_with_a_remedy(text):
    with pytest.raises(InvalidInput) as caught:
        parse_faults(text)
    assert "faults" in caught.value.name


@pytest.mark.parametrize(
    ("config", "text"),
    [
        (ROV, "friction 1 of viscous_1"),
        (ARM, "payload 1 on link 9"),
        (VEHICLES["remus100"], "payload 1"),
        (INEXACT["rover"], "friction 1 of c_0"),
        (ARM, "bias 0.1 of position 3"),
        (ARM, "stuck 3"),
    ],
)
def test_a_fault_of_a_part_that_is_not_there_is_refused_before_the_run(config, text):
    with pytest.raises(NsaidError):
        made(config, text)
