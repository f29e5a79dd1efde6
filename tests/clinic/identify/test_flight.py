"""Flight logs of PX4 and ArduPilot, without a map: curve, lag and delay of the rotors are found."""

import json
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nsaid_mj.cli.commands import command
from nsaid_mj.clinic.identify.choose.timing import Timing
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.clinic.logs.unusable import UnmatchedChannels
from nsaid_mj.core.log import Log
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.assets import asset
from nsaid_mj.robots.model import RobotModel
from tests.support.flight_logs import MOTORS, speeds, topics, write_dataflash, write_ulog

DELAY, LAG, TOP = 0.02, 0.03, 1500.0


class Flight(NamedTuple):
    """What the hummingbird did, whose rotors lag in MuJoCo and get commands late; its true θ."""

    log: Log
    truth: np.ndarray


def flown(duration: float, seed: int, **style: float) -> Flight:
    scenario = replace(load("hummingbird"), duration=duration, sensors="ideal", seed=seed)
    plant = replace(scenario.plant, mismatch=Mismatch(lag=LAG, delay=DELAY))
    excitation = replace(scenario.excitation, **style)
    setup = Setup.of(replace(scenario, plant=plant, excitation=excitation))
    with setup.plant.running():
        return Flight(setup.simulate(), setup.plant.truth)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return flown(6.0, 3)


def scatter(values: np.ndarray) -> float:
    """The largest relative deviation of values from their mean."""
    return float(np.abs(values / values.mean() - 1).max())


@pytest.fixture(scope="module")
def quadrotor() -> RobotModel:
    return load_robot_model("hummingbird")


OTHERS = [pytest.param(mix, marks=pytest.mark.slow) for mix in (0.0, 1.0)]


@pytest.mark.parametrize("mix", [0.6, *OTHERS])
def test_two_commands_lead_from_a_px4_log_to_thrust_ratios(flight, tmp_path, mix):
    """Without position, map or known curve: the commands of docs/flight.md, in its folder."""
    log = write_ulog(tmp_path / "flight.ulg", topics(flight.log, mix))
    sheet, out = tmp_path / "quad.toml", tmp_path / "found"
    own = asset("hummingbird", "vehicle.toml").read_text()
    sheet.write_text(own)
    model = ["--model", str(sheet)]
    assert command(["inspect", str(log), *model, "--out", str(tmp_path / "seen")]) == 0
    said = ["identify", *model, "--log", str(log), "--out", str(out), "--quiet"]
    assert command(said) in {0, 1}  # 1: partly
    found = json.loads((out / "identification.json").read_text())
    data = {finding["code"]: finding["data"] for finding in found["findings"]}
    assert "standard_map" in data
    assert data.get("curve", {"mix": 1.0})["mix"] == pytest.approx(mix, abs=0.02)
    assert data["lag"]["seconds"] == pytest.approx(LAG, abs=0.002)
    assert found["joints"][0]["delay"] == pytest.approx(DELAY, abs=0.002)  # held for 2.5 ms
    at = [i for i, p in enumerate(found["parameters"]) if p["name"].startswith("thrust_")]
    thrust = np.array([found["parameters"][i]["value"] for i in at]) / flight.truth[at]
    assert scatter(thrust) <= 0.02
    assert found["explains"] != "no" and (out / "calibrated.yaml").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(("mix", "dead"), [(1.0, 0.08), (0.4, 0.12), (0.0, 0.15)])
def test_motors_that_begin_to_turn_above_zero_are_no_force_that_pulls_down(
    flight, tmp_path, mix, dead
):
    """Instead, a constant force in heave was .8 of the weight, and thrusts a quarter too large."""
    log = write_ulog(tmp_path / "flight.ulg", topics(flight.log, mix, dead))
    found = identify_forces("hummingbird", log, known={"m": float(flight.truth[0])})
    assert not any("offset" in joint.columns for joint in found.joints)
    data = {finding.code: finding.data for finding in found.findings}
    assert data["curve"]["dead zone"] == pytest.approx(dead, abs=0.02)
    at = [i for i, p in enumerate(found.parameters) if p.name.startswith("thrust_")]
    thrust = found.theta[at] / flight.truth[at]
    assert scatter(thrust) <= 0.02 and thrust == pytest.approx(1.0, abs=0.04)


def measured(flight: Flight, rate: float) -> dict:
    return topics(flight.log, 0.6) | speeds(flight.log, rate, LAG, DELAY, TOP)


def test_measured_speeds_replace_commands_their_curve_and_lag(flight, tmp_path, quadrotor):
    logged = measured(flight, 200.0)
    columns, t = logged["esc_status"]  # speed controllers in the order of their outputs
    turned = {f"esc[{3 - i}].esc_rpm": x * (-1) ** i for i, x in enumerate(columns.values())}
    turned |= {f"esc[{3 - i}].actuator_function": np.full(len(t), 101.0 + i) for i in range(4)}
    found = []
    for name, esc in (("plain", columns), ("turned", turned)):
        log = write_ulog(tmp_path / f"{name}.ulg", logged | {"esc_status": (esc, t)})
        found.append(identify_forces("hummingbird", log, known={"m": float(flight.truth[0])}))
    own, codes = found[0].parameters, {f.code: f for f in found[0].findings}
    assert "measured speeds are used" in codes["standard_map"].text
    assert not {"curve", "lag"} & set(codes) and abs(found[0].joints[0].delay) < 2e-3
    at = [i for i, p in enumerate(own) if p.name.startswith("thrust_")]
    thrust = np.array([own[i].value for i in at]) / flight.truth[at]
    assert scatter(thrust) <= 0.02 and thrust == pytest.approx(1.0, abs=0.02)
    np.testing.assert_array_equal(found[0].theta, found[1].theta)


@pytest.mark.parametrize(
    ("rate", "size", "why"),
    [(200.0, 0.0, "0.0 throughout"), (10.0, 1.0, "come at 10 Hz only")],
)
def test_speeds_that_say_little_change_nothing(flight, tmp_path, quadrotor, rate, size, why):
    logged = measured(flight, rate)
    columns, t = logged["esc_status"]
    some = logged | {"esc_status": ({name: size * x for name, x in columns.items()}, t)}
    none = {name: topic for name, topic in logged.items() if name != "esc_status"}
    both = [
        prepare(read_tables([write_ulog(tmp_path / f"{k}.ulg", each)]), None, quadrotor)
        for k, each in enumerate((some, none))
    ]
    np.testing.assert_array_equal(both[0].segments[0].log.u, both[1].segments[0].log.u)
    (note,) = [f.text for f in both[0].findings if f.code == "standard_map"]
    assert "measured speeds" in note and why in note


def test_speeds_of_one_instant_are_not_used(flight, tmp_path, quadrotor):
    logged = measured(flight, 200.0)
    columns, t = logged["esc_status"]
    log = write_ulog(tmp_path / "log.ulg", logged | {"esc_status": (columns, 0 * t + t[0])})
    (note,) = [
        f.text
        for f in prepare(read_tables([log]), None, quadrotor).findings
        if f.code == "standard_map"
    ]
    assert "come at 0 Hz only" in note or "measured speeds" not in note


def test_controllers_that_contradict_each_other_are_not_used(flight, tmp_path, quadrotor):
    """One says that it drives the motor of another, which says nothing."""
    logged = measured(flight, 200.0)
    columns, t = logged["esc_status"]
    told = columns | {"esc[0].actuator_function": np.full(len(t), 102.0)}
    log = write_ulog(tmp_path / "log.ulg", logged | {"esc_status": (told, t)})
    (note,) = [
        f.text
        for f in prepare(read_tables([log]), None, quadrotor).findings
        if f.code == "standard_map"
    ]
    assert "measured speeds" not in note and "actuator_motors" in note


@pytest.mark.slow
def test_a_law_follows_the_commands_as_they_act(flight, tmp_path):
    """Without curve and lag its gains were 25 % off and the last fifth was predicted to .28."""
    log = write_ulog(tmp_path / "flight.ulg", topics(flight.log, 0.6))
    known = {"m": float(flight.truth[0])}
    law = identify_forces("hummingbird", log, known=known, law="efficient").law
    assert law is not None and law.completed and law.last.max() < 0.2
    for gain in law.gains:
        assert gain.law == pytest.approx(gain.batch, rel=0.1)


SMOOTH = {"radius": 5.0, "speed": 6.0, "climb": 3.0, "yaw_rate": 2.0, "dither": 0.01}
GENTLE = {"radius": 2.0, "speed": 1.0, "climb": 0.5, "yaw_rate": 0.3, "dither": 0.08, "tilt": 0.3}


@pytest.mark.parametrize(
    ("style", "seed"),
    [
        (SMOOTH, 11),
        *(
            pytest.param(x, n, marks=pytest.mark.slow)
            for x, n in ((SMOOTH, 12), (GENTLE, 11), (GENTLE, 12), (GENTLE, 13))
        ),
    ],
)
def test_intervals_hold_where_noise_exceeds_fast_accelerations(tmp_path, style, seed):
    """The noise passed for drag and inertia: −70 % and +5 %, in intervals of ± 30 % and ± 1 %."""
    flight = flown(20.0, seed, **style)
    log = write_ulog(tmp_path / "flight.ulg", topics(flight.log, 0.6))
    found = identify_forces("hummingbird", log, known={"m": float(flight.truth[0])})
    own = found.parameters[: len(flight.truth)]
    stated = [(p, true) for p, true in zip(own, flight.truth, strict=True) if p.low < p.high]
    covered = [p.low <= true <= p.high for p, true in stated if p.status == "identified"]
    assert len(covered) >= 15 and np.mean(covered) >= 0.8
    thrust = np.array([p.value / true for p, true in stated if p.name.startswith("thrust_")])
    assert scatter(thrust) <= 0.02
    assert thrust == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("measure", [False, True])
def test_a_dataflash_log_needs_no_map(flight, tmp_path, measure):
    turned = {name: columns for name, (columns, _) in topics(flight.log).items()}
    attitude, stamps = turned["vehicle_attitude"]["q"], flight.log.t + 1
    yaw, pitch, roll = Rotation.from_quat(attitude, scalar_first=True).as_euler("ZYX").T
    pulses = 1000 + 1000 * turned["actuator_motors"]["control"]
    names = zip(("vx", "vy", "vz"), ("VN", "VE", "VD"), strict=True)
    kinds = {
        "ATT": (
            {"Roll": np.degrees(roll), "Pitch": np.degrees(pitch), "Yaw": np.degrees(yaw) % 360},
            stamps[::2],
        ),
        "XKF1": (
            {new: turned["vehicle_local_position"][old] for old, new in names},
            stamps[::2],
        ),
        "IMU": (
            dict(
                zip(
                    ("GyrX", "GyrY", "GyrZ"),
                    turned["vehicle_angular_velocity"]["xyz"].T,
                    strict=True,
                )
            ),
            stamps,
        ),
        "RCOU": ({f"C{i + 1}": pulse for i, pulse in enumerate(pulses.T)}, stamps),
    }
    if measure:
        columns, t = measured(flight, 400.0)["esc_status"]
        number = np.tile(np.arange(4, dtype=np.uint8), len(t))
        rpm = np.column_stack(list(columns.values())).ravel()
        kinds["ESC"] = ({"Instance": number, "RPM": rpm}, np.repeat(t, 4))
    log = write_dataflash(tmp_path / "flight.bin", kinds)
    quadrotor = load_robot_model("hummingbird")
    (segment,) = prepare(read_tables([log]), None, quadrotor).segments
    at = np.searchsorted(flight.log.t, segment.log.t + flight.log.t[0] - 1e-6)
    error = Rotation.from_quat(segment.log.q[:, 3:]).inv() * Rotation.from_quat(
        flight.log.q[at, 3:]
    )
    assert np.max(error.magnitude()) < 0.02
    np.testing.assert_allclose(segment.log.v, flight.log.v[at], atol=0.15)
    expected = flight.log.u[at] ** 2  # commands are low-passed
    if measure:
        columns, t = measured(flight, 400.0)["esc_status"]
        for rotor, rpm in zip(MOTORS, columns.values(), strict=True):
            expected[:, rotor] = np.interp(segment.log.t + 1, t, rpm * np.pi / 30 / TOP)
    assert np.abs(segment.log.u - expected).mean(axis=0).max() < 1e-3


def test_a_position_is_integrated_where_a_log_has_none(flight, tmp_path, quadrotor):
    log = write_ulog(tmp_path / "flight.ulg", topics(flight.log))
    (segment,) = prepare(read_tables([log]), None, quadrotor).segments
    assert np.allclose(segment.log.q[0, :3], 0)
    moved = segment.log.q[-1, :3] - (flight.log.q[-1, :3] - flight.log.q[0, :3])
    assert np.abs(moved).max() < 0.1  # of noise .02 m/s


@pytest.mark.parametrize("missing", ["actuator_motors", "vehicle_attitude"])
def test_a_log_without_a_standard_topic_asks_for_a_map(flight, tmp_path, quadrotor, missing):
    some = {name: topic for name, topic in topics(flight.log).items() if name != missing}
    log = write_ulog(tmp_path / "flight.ulg", some)
    with pytest.raises(UnmatchedChannels, match=r"map\.toml"):
        prepare(read_tables([log]), None, quadrotor)


def test_an_underwater_vehicle_is_not_taken_for_a_quadrotor(flight, tmp_path):
    log = write_ulog(tmp_path / "flight.ulg", topics(flight.log))
    with pytest.raises(UnmatchedChannels, match=r"map\.toml"):
        prepare(read_tables([log]), None, load_robot_model("bluerov2"))


@pytest.mark.parametrize("mix", [0.0, 0.4, 1.0])
def test_a_held_command_gives_the_thrust_of_its_curve(mix):
    u = np.tile([[0.2, -0.5, 1.0]], (400, 1))
    for lag in (0.0, 0.03):
        thrust = np.sign(u) * Timing(0.0, mix, lag).speeds(u, 200.0) ** 2
        np.testing.assert_allclose(thrust, mix * u * np.abs(u) + (1 - mix) * u, atol=1e-12)


def test_a_lag_answers_a_ramp_as_its_equation_does():
    t = np.arange(2000) / 1000
    found = Timing(0.0, 1.0, 0.05).speeds(t[:, None], 1000.0)[:, 0]
    np.testing.assert_allclose(found, t - 0.05 * (1 - np.exp(-t / 0.05)), atol=1e-9)
