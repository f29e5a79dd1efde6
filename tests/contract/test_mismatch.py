"""Mismatches act as documented, are reported, and are refused where they have no effect."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.cli.commands import command
from nsaid_mj.cli.grammar import RunOptions
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.evaluation.summary import result_from
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.options import parse_flags
from nsaid_mj.lab.plants.jointed import ArmPlant, FloatingBasePlant, FlyingArmPlant, UvmsPlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.vehicles import (
    AstrobeePlant,
    BlueROV2Plant,
    BMW320iPlant,
    QuadrotorPlant,
)
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.report import ExitCode
from tests.support.fossen import apart, commands, ends, flown, true_numbers, vehicle
from tests.support.plants import name_of, path, random_commands, start_of
from tests.support.summaries import summarize
from tests.support.vehicles import VEHICLES, acceleration, coordinate_map

FLOW = (0.4, -0.3, 0.2)
DT = 2e-3


def made(config: PlantConfig, dt: float = DT, **switches: Any) -> Plant:
    return replace(config, mismatch=Mismatch(**switches)).build(dt, 4)


ANY = [ScalarRovPlant(), ArmPlant("double_pendulum"), FloatingBasePlant("bolt"), *VEHICLES.values()]
every_plant = pytest.mark.parametrize("config", ANY, ids=name_of)


# -- delay -------------------------------------------------------------------------------------


@every_plant
@pytest.mark.parametrize("k", [1, 7])
def test_a_delayed_command_arrives_k_steps_later(config, k):
    prompt, late = made(config), made(config, delay=k * DT)
    u = random_commands(prompt)
    waiting = np.vstack([np.zeros((k, prompt.system.n_u)), u[:-k]])
    at = start_of(prompt)
    expected = path(prompt, waiting, *at)
    assert (path(late, u, *at) == expected).all()
    assert (path(late, u, *at) == expected).all()  # a reset forgets what was on its way
    assert (path(prompt, u, *at) != expected).any()
    assert late.mismatches == (f"commands arrive {k * DT:g} s late",)


def test_from_rest_a_delay_shifts_the_motion():
    """A free-flyer at rest waits; to the bit, since nothing depends on the time."""
    prompt, late = made(AstrobeePlant()), made(AstrobeePlant(), delay=5 * DT)
    u, rest = random_commands(prompt), (np.zeros(6), np.zeros(6))
    one, other = path(prompt, u, *rest), path(late, u, *rest)
    assert (other[:6] == 0).all() and (other[5:] == one[:-5]).all()


def test_a_delayed_command_is_a_copy_of_the_command_given():
    """A driver may write every command into one and the same array."""
    p, rest = made(AstrobeePlant(), delay=5 * DT), (np.zeros(6), np.zeros(6))
    u, one = random_commands(p), np.zeros(12)

    def overwritten():
        for row in u:
            one[:] = row
            yield one

    assert (path(p, overwritten(), *rest) == path(p, u, *rest)).all()


def test_a_delay_is_reported_in_whole_steps():
    assert made(AstrobeePlant(), delay=0.4 * DT).mismatches == ()
    assert made(AstrobeePlant(), delay=2.4 * DT).mismatches == (
        f"commands arrive {2 * DT:g} s late",
    )
    assert made(AstrobeePlant(), delay=2.4 * DT).delay == 2


# -- lag ---------------------------------------------------------------------------------------


@every_plant
def test_a_lagging_actuator_is_a_first_order_filter(config):
    tau, p = 0.05, made(config, lag=0.05)
    u = random_commands(p)[0]
    with p.running():
        p.reset(*start_of(p))
        assert (p.data.act == 0).all()
        for k in range(1, 101):
            p.step(u)
            np.testing.assert_allclose(p.data.act, u * (1 - np.exp(-k * DT / tau)), rtol=1e-6)
        p.reset(*start_of(p))
        assert (p.data.act == 0).all()
    assert p.mismatches == (f"actuators lag by {tau:g} s",)


@every_plant
def test_force_follows_the_activation_not_the_command(config):
    prompt, lagging = made(config), made(config, lag=0.05)
    (numbers, v), u = start_of(prompt), random_commands(prompt)[0]
    at_zero = acceleration(prompt, numbers, v, 0 * u)
    assert (acceleration(lagging, numbers, v, u) == at_zero).all()
    with lagging.running():
        lagging.reset(numbers, v)
        lagging.data.act[:] = u
        mujoco.mj_forward(lagging.model, lagging.data)
        at = coordinate_map(lagging)
        a = lagging.data.qacc.copy() if at is None else at.acceleration(lagging.data)
    expected = acceleration(prompt, numbers, v, u)
    np.testing.assert_allclose(a, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    assert np.abs(expected - at_zero).max() > 1e-6


def test_a_lagging_bluerov2_follows_fossens_equations_with_eight_more_states():
    true, series = true_numbers("full"), commands(2)
    lagging = Mismatch(lag=0.2, flow=FLOW)
    p = vehicle(true, 1e-3, lagging)
    expected, found = flown(true, series, 1.0, lagging), ends(p, series, 1.0)
    assert apart(found, expected) <= 1e-8
    np.testing.assert_allclose(found[13:], expected[13:], atol=1e-10)
    assert apart(found, flown(true, series, 1.0, Mismatch(flow=FLOW))) > 1e-2


def test_steps_with_a_lag_are_of_fourth_order():
    """In steps of any size; MuJoCo's `filterexact` would be of first order under RK4."""
    true = replace(true_numbers("full"), quadratic=np.zeros(6))
    expected = flown(true, commands(1), 0.64, Mismatch(lag=0.2))
    steps = np.array([0.04, 0.02, 0.01])
    errors = [
        apart(ends(vehicle(true, dt, Mismatch(lag=0.2)), commands(1), 0.64), expected)
        for dt in steps
    ]
    assert 3.5 < np.polyfit(np.log(steps), np.log(errors), 1)[0] < 4.5, errors


def test_lag_and_delay_add_up():
    p = made(AstrobeePlant(), lag=0.05, delay=5 * DT)
    u = np.full(12, 0.5)
    with p.running():
        p.reset(np.zeros(6), np.zeros(6))
        for _ in range(20):
            p.step(u)
    np.testing.assert_allclose(p.data.act, 0.5 * (1 - np.exp(-15 * DT / 0.05)), rtol=1e-6)
    assert len(p.mismatches) == 2


def test_a_lag_too_short_for_the_step_is_refused():
    with pytest.raises(InvalidInput) as caught:
        made(AstrobeePlant(), dt=0.1, lag=0.03)
    assert caught.value.name.endswith("mismatch.lag") and caught.value.remedy
    p = made(AstrobeePlant(), dt=0.1, lag=0.04)
    states = path(p, np.full((200, 12), 0.5), np.zeros(6), np.zeros(6))
    assert np.isfinite(states).all()
    np.testing.assert_allclose(p.data.act, 0.5, rtol=1e-9)


# -- flow --------------------------------------------------------------------------------------


def drifting(p: Plant) -> Array:
    """(n,) velocity of a body that rests relative to the flow, at the attitude of `turned`."""
    turn = p.system.position(turned(p))
    up = np.zeros(6)
    x, y, z, w = turn[3:7]
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    up[:3] = R.T @ FLOW
    return up


def turned(p: Plant) -> Array:
    return np.r_[np.zeros(3), 0.4, -0.3, 0.8]


FLUID = [BlueROV2Plant(), VEHICLES["remus100"], QuadrotorPlant()]


@pytest.mark.parametrize("config", FLUID, ids=name_of)
@pytest.mark.parametrize("fluid", ["exact", "ellipsoid"])
def test_at_rest_in_the_flow_acceleration_is_that_at_rest_in_still_fluid(config, fluid):
    """Galilei: no drag, no lift, no added mass's force, whatever the vehicle's attitude."""
    still, flowing = made(config, fluid=fluid), made(config, fluid=fluid, flow=FLOW)
    u = 0 * random_commands(still)[0]
    expected = acceleration(still, turned(still), np.zeros(6), u)
    found = acceleration(flowing, turned(still), drifting(flowing), u)
    np.testing.assert_allclose(found, expected, atol=1e-10 * (1 + np.abs(expected).max()))
    against = acceleration(still, turned(still), drifting(still), u)
    assert np.abs(against - expected).max() > 1e-3


@pytest.mark.parametrize("config", FLUID, ids=name_of)
def test_motion_in_a_steady_flow_is_that_in_still_fluid_carried_along(config):
    """The whole motion in a flow is that in still fluid, carried along."""
    still, flowing = made(config), made(config, flow=FLOW)
    u = random_commands(still, 200)
    at = turned(still), np.array([0.3, -0.2, 0.1, 0.4, 0.2, -0.3])
    carried = at[0], at[1] + drifting(still)
    one, other = path(still, u, *at), path(flowing, u, *carried)
    t = DT * np.arange(len(one))[:, None]
    np.testing.assert_allclose(other[:, :3] - t * FLOW, one[:, :3], atol=1e-9)
    np.testing.assert_allclose(other[:, 3:6], one[:, 3:6], atol=1e-9)
    np.testing.assert_allclose(other[:, 9:], one[:, 9:], atol=1e-9)


@pytest.mark.parametrize("fluid", ["exact", "ellipsoid"])
def test_a_free_body_drifts_with_the_current(fluid):
    p = made(BlueROV2Plant(), dt=0.02, flow=(0.5, 0.3, 0.0), fluid=fluid)
    way = path(p, np.zeros((3000, 8)), np.zeros(6), np.zeros(6))[:, :2]
    speed = (way[-1] - way[-51]) / 1.0
    assert (np.diff(way[::50], axis=0) > 0).all()  # never against it
    assert (speed > 0.75 * np.array([0.5, 0.3])).all() and (speed < [0.55, 0.35]).all()
    away = made(BlueROV2Plant(), dt=0.02, flow=(-0.5, 0.0, 0.0), fluid=fluid)
    assert path(away, np.zeros((500, 8)), np.zeros(6), np.zeros(6))[-1, 0] < -0.5


def test_a_level_wind_pushes_a_car():
    config = BMW320iPlant()
    still = made(config)
    v, u = np.array([20.0, 0, 0]), np.zeros(2)
    a = {
        wind: acceleration(made(config, flow=(wind, 0.0, 0.0)), np.zeros(3), v, u)[0]
        for wind in (-10.0, 0.0, 10.0)
    }
    assert a[-10.0] < a[0.0] < a[10.0]
    assert a[0.0] == acceleration(still, np.zeros(3), v, u)[0]
    with pytest.raises(InvalidInput, match="level wind"):
        made(config, flow=(0.0, 0.0, 1.0))


# -- MuJoCo's own fluid ------------------------------------------------------------------------


@pytest.mark.parametrize("config", FLUID, ids=name_of)
def test_the_ellipsoid_model_brakes_without_added_inertia(config):
    exact, other = made(config), made(config, fluid="ellipsoid")
    idle, place = 0 * random_commands(exact)[0], np.zeros(6)
    M = np.zeros((6, 6))
    mujoco.mj_forward(other.model, other.data)
    mujoco.mj_fullM(other.model, other.data, M)
    assert M[0, 0] == pytest.approx(other.model.body_mass[-1])
    assert (other.truth == exact.truth).all()  # the structure stays the exact one's
    for axis in range(3):
        v = 2.0 * np.eye(6)[axis]
        a = acceleration(other, place, v, idle) - acceleration(other, place, 0 * v, idle)
        assert a[axis] < 0
        assert (
            a[axis]
            != (acceleration(exact, place, v, idle) - acceleration(exact, place, 0 * v, idle))[axis]
        )
    assert other.mismatches == ("MuJoCo's ellipsoid fluid instead of the structure's",)


# -- reported --------------------------------------------------------------------------------------


ALL = Mismatch(lag=0.1, delay=0.05, flow=(0.1, 0.0, -0.2), fluid="ellipsoid")
SHORT: dict[str, Any] = {"duration": 1.0, "held_out": 1.0, "pe_window": 0.5}


def test_the_summary_lists_every_mismatch_and_the_sensors_noise_by_itself(tmp_path):
    scenario = replace(load("bluerov2"), plant=BlueROV2Plant(mismatch=ALL), **SHORT)
    noise = SensorNoise(1e-3, 2e-3, 0.01)
    for sensors, words in (
        ("ideal", ""),
        (
            "noisy",
            "noise of 0.001 m and rad, 0.002 m/s and rad/s; positions quantised to 0.01 m and rad",
        ),
    ):
        done = run(replace(scenario, sensors=sensors, noise=noise), tmp_path / sensors)
        summary = summarize(done, Truth.of(done))
        assert summary["sensor_noise"] == words
        assert summary["mismatch"] == [
            "actuators lag by 0.1 s",
            "commands arrive 0.05 s late",
            "flow of 0.1, 0, -0.2 m/s",
            "MuJoCo's ellipsoid fluid instead of the structure's",
        ]
    exact = run(replace(load("bluerov2"), **SHORT), tmp_path / "exact")
    assert summarize(exact, Truth.of(exact))["mismatch"] == []


def test_a_mismatch_changes_the_record_and_not_the_prior(tmp_path):
    base = replace(load("bluerov2"), **SHORT)
    plain = run(base, tmp_path / "plain")
    for name in ("lag", "delay", "flow", "fluid"):
        only = Mismatch(**{name: getattr(ALL, name)})
        other = run(replace(base, plant=BlueROV2Plant(mismatch=only)), tmp_path / name)
        assert (other.prior == plain.prior).all() and (other.plant.truth == plain.plant.truth).all()
        assert (other.record["v"][-1] != plain.record["v"][-1]).any(), name


# -- refused -----------------------------------------------------------------------------------


NOTHING_TO_ACT_ON = [
    (ArmPlant("ur5"), ("flow", "fluid")),
    (FloatingBasePlant("solo12"), ("flow", "fluid")),
    (ScalarRovPlant(), ("flow", "fluid")),
    (AstrobeePlant(), ("flow", "fluid")),
    (BMW320iPlant(), ("fluid",)),
    (UvmsPlant(), ("fluid",)),
    (FlyingArmPlant(), ("flow", "fluid")),
]


@pytest.mark.parametrize(("config", "fields"), NOTHING_TO_ACT_ON, ids=lambda x: str(x)[:20])
def test_a_mismatch_without_effect_is_refused_with_the_remedy(config, fields):
    for name in fields:
        with pytest.raises(InvalidInput) as caught:
            replace(config, mismatch=Mismatch(**{name: getattr(ALL, name)}))
        assert caught.value.name == f"mismatch.{name}" and caught.value.remedy
    both = Mismatch(lag=0.1, delay=0.05)  # these act on any actuator
    assert replace(config, mismatch=both).mismatch == both


BAD = {
    "lag": [-1.0, np.nan, np.inf],
    "delay": [-1e-9, np.nan, np.inf],
    "flow": [(0.0, 0.0), (0.0, 0.0, np.nan), (np.inf, 0.0, 0.0), 0.3, ()],
    "fluid": ["water", "", None],
}


@pytest.mark.parametrize(("field", "value"), [(f, v) for f, bad in BAD.items() for v in bad])
def test_a_bad_mismatch_value_is_refused_by_name(field, value):
    with pytest.raises(InvalidInput) as caught:
        Mismatch(**{field: value})
    assert caught.value.name.startswith(f"plant.mismatch.{field}") and caught.value.remedy


# -- as data -----------------------------------------------------------------------------------


def test_a_mismatch_survives_json_and_changes_the_hash():
    scenario = Scenario(plant=BlueROV2Plant(mismatch=ALL))
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario and again.hash == scenario.hash
    assert isinstance(again.plant.mismatch.flow, tuple)
    hashes = {
        Scenario(plant=BlueROV2Plant(mismatch=Mismatch(**{f: getattr(ALL, f)}))).hash for f in BAD
    } | {scenario.hash, Scenario(plant=BlueROV2Plant()).hash}
    assert len(hashes) == 6
    tree = json.loads(scenario.to_json())
    tree["plant"]["mismatch"]["lag"] = -1.0
    with pytest.raises(InvalidInput, match=r"mismatch\.lag"):
        Scenario.from_json(json.dumps(tree))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--plant.mismatch.lag 0.1", {"lag": 0.1}),
        ("--lag 0.1 --delay=0.02", {"lag": 0.1, "delay": 0.02}),
        ("--flow 0.1 0 -0.2", {"flow": (0.1, 0.0, -0.2)}),
        ("--flow -0.1 -1e-3 0", {"flow": (-0.1, -1e-3, 0.0)}),
        ("--plant.mismatch.fluid ellipsoid", {"fluid": "ellipsoid"}),
        ("--fluid ellipsoid", {"fluid": "ellipsoid"}),
    ],
)
def test_a_mismatch_is_a_flag(words, expected):
    scenario, _ = parse_flags("bluerov2", load("bluerov2"), words.split(), "run", RunOptions)
    assert scenario.plant.mismatch == Mismatch(**expected)
    assert replace(scenario, plant=BlueROV2Plant()) == load("bluerov2")


def test_a_run_from_the_command_line(tmp_path, capsys):
    words = "--plant.mismatch.lag 0.1 --duration 2 --held-out 1 --pe-window 1 --json --out"
    code = command(["run", "bluerov2", *words.split(), str(tmp_path / "out")])
    summary = json.loads(capsys.readouterr().out)
    assert code == ExitCode.of(result_from(summary))
    assert summary["status"] == "completed" and summary["mismatch"] == ["actuators lag by 0.1 s"]
    stored = Scenario.from_json((tmp_path / "out/scenario.json").read_text(encoding="utf-8"))
    assert stored.plant.mismatch == Mismatch(lag=0.1)


def test_a_refused_mismatch_ends_the_command_before_anything_is_written(tmp_path):
    with pytest.raises((InvalidInput, SystemExit)):
        command(["run", "ur5", "--fluid", "ellipsoid", "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()
