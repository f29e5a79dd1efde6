"""Robots as people have them, by the documented command: servos are found, intervals hold."""

import json

import mujoco
import numpy as np
import pytest

from nsaid_mj.cli.commands import command
from tests.support import menagerie
from tests.support.menagerie import HEAVY_ARM, LEG, SOFT_ARM, STIFF_ARM, TORQUE_ARM, write

FINGERS = ["--lock", "left_finger,right_finger"]
CASES = {
    "stiff": (STIFF_ARM, FINGERS, 12.0),
    "soft": (SOFT_ARM, FINGERS, 25.0),
    "heavy": (HEAVY_ARM, [], 20.0),
    "leg": (LEG, [], 12.0),
}


def identified(folder, robot, locked, logs, options=()):
    """What `nsaid inspect` and `nsaid identify` lead to, and the calibrated file."""
    files = [
        str(write(folder / f"log_{k}.csv", robot, *menagerie.log(robot, **log)))
        for k, log in enumerate(logs)
    ]
    out = folder / "found"
    model = ["--model", str(robot.path), *locked]
    assert command(["inspect", *files, *model, "--out", str(folder / "seen")]) == 0
    said = ["identify", *model, "--log", *files, *options]
    assert command([*said, "--out", str(out), "--quiet"]) == 0
    model = next(out.glob("*.xml"))
    return json.loads((out / "identification.json").read_text()), model


_ALWAYS = ("leg",)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=() if name in _ALWAYS else pytest.mark.slow) for name in CASES
    ],
)
def case(request, tmp_path_factory):
    robot, options, seconds = CASES[request.param]
    logs = [{"seed": seed, "seconds": seconds} for seed in range(2)]
    folder = tmp_path_factory.mktemp(request.param)
    return robot, *identified(folder, robot, options, logs)


def truth(robot, name, k):
    kp = robot.kp[k]
    return {
        "T": robot.kv[k] / kp,
        "f": robot.friction[k] / kp,
        "kp": kp,
        "a": robot.armature[k] / kp,
        "d": robot.delay,
        "armature": robot.armature[k],
    }[name]


def test_servos_are_found(case):
    robot, found, _ = case
    assert found["explains"] == "yes"
    for k, servo in enumerate(found["servos"]):
        assert servo["kp"] == pytest.approx(robot.kp[k], rel=0.05)
        assert servo["friction"] == pytest.approx(robot.friction[k], rel=0.1)
        assert servo["kv"] == pytest.approx(robot.kv[k], rel=0.15)
        assert servo["delay"] == pytest.approx(robot.delay, abs=1e-3)


def test_intervals_hold(case):
    robot, found, _ = case
    held = [
        p["low"] <= truth(robot, p["name"].rpartition("_")[0], int(p["name"][-1]) - 1) <= p["high"]
        for p in found["parameters"]
    ]
    assert np.mean(held) >= 0.9


def slow(robot, rng, t):
    """(N, n) smooth targets that hardly accelerate."""
    w, half = 2 * np.pi * np.array([0.2, 0.4, 0.6]), (robot.high - robot.low)[:, None] / 8
    phase = rng.uniform(0, 2 * np.pi, (len(robot.joints), 3))
    return (half * np.sin(w * t[:, None, None] + phase)).sum(axis=2)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_intervals_of_overdamped_servos_without_friction_hold(tmp_path, seed):
    """In the Menagerie kv/kp is 0.1 to 0.2 s and armature is small: a slow motion shows neither
    armature nor delay, and critical damping would be a hundred times as much armature."""
    kp = np.array([2000.0, 2100.0, 1900.0, 500.0])
    robot = STIFF_ARM._replace(
        kp=kp, kv=0.18 * kp, friction=0 * kp, armature=0 * kp + 0.1, rate=100.0, delay=0.012
    )
    log = {"seed": seed, "seconds": 40.0, "command": slow}
    found, _ = identified(tmp_path, robot, FINGERS, [log])
    assert found["explains"] == "yes"
    for p in found["parameters"]:
        name, _, k = p["name"].rpartition("_")
        if name in {"T", "f", "a", "d"}:
            high = np.inf if p["high"] is None else p["high"]  # not determined
            assert p["low"] <= truth(robot, name, int(k) - 1) <= high, p["name"]


def test_the_exported_file_follows_the_logs(case):
    robot, found, model = case
    (replay,) = [f for f in found["findings"] if f["code"] == "replay"]
    assert np.mean(replay["data"]["exported"]) < 1.5  # mrad, at the file's own time step
    assert np.mean(replay["data"]["exported"]) < 0.1 * np.mean(replay["data"]["nominal"])
    ours, theirs = (mujoco.MjModel.from_xml_path(str(p)) for p in (model, robot.path))
    for field in ("body_mass", "body_inertia", "jnt_range", "actuator_ctrlrange", "eq_data"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))


def test_saturation_is_found_where_it_is(case):
    """The stiff arm's moves are too fast for its shoulder; the same limits bound the others."""
    robot, found, model = case
    limits = {s["name"]: s["limit"] for s in found["servos"] if s["limit"] is not None}
    assert limits == ({"shoulder": 87.0} if robot is STIFF_ARM else {})
    mj = mujoco.MjModel.from_xml_path(str(model))
    limited = [j for j in robot.joints if mj.actuator(j.removesuffix("_joint")).forcelimited[0]]
    assert limited == list(limits)
    assert [f["code"] for f in found["findings"]].count("saturation") == bool(limits)


def test_rotors_and_friction_of_an_arm_under_torque_control(tmp_path):
    """Torques in N·m are known: `--known gain_2=1` fixes the scale, and intervals are absolute."""
    logs, found = [{"seed": 0, "seconds": 20.0}], {}
    result, _ = identified(tmp_path, TORQUE_ARM, [], logs, ["--known", "gain_2=1"])
    assert result["explains"] == "yes"
    true = {"rotor": "armature", "viscous": "kv", "coulomb": "friction"}
    for p in result["parameters"]:
        name, _, k = p["name"].rpartition("_")
        if name in true:
            value = getattr(TORQUE_ARM, true[name])[int(k) - 1]
            assert p["value"] == pytest.approx(value, rel=0.1)
            found[p["name"]] = p["low"] <= value <= p["high"]
    assert len(found) == 9 and np.mean(list(found.values())) >= 0.9
