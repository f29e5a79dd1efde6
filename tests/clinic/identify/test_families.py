"""A simulated log of each family of vehicles, and logs from which little can be told."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from nsaid_mj import AxisMultisine, Driving
from nsaid_mj.cli.commands import command
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.assets import asset


class Found(NamedTuple):
    """What `nsaid identify` says of a log.

    Attributes:
        said: the content of identification.json.
        gains: of the actuators, over the true ones.
        off: of each identified parameter, its error over the half-width of its interval.
    """

    said: dict[str, Any]
    gains: np.ndarray
    off: np.ndarray


def identified(
    folder: Path, name: str, seconds: float, excitation: object = None, seed: int = 11, **mismatch
) -> Found:
    """The result for a noisy log of a packed vehicle, with its sheet and its first mass known."""
    scenario = replace(load(name), duration=seconds, sensors="noisy", seed=seed)
    scenario = replace(scenario, plant=replace(scenario.plant, mismatch=Mismatch(**mismatch)))
    setup = Setup.of(replace(scenario, excitation=excitation or scenario.excitation))
    with setup.plant.running():
        log, truth = setup.simulate(), setup.plant.truth
    names = [f"{x}_{k}" for x in "qvu" for k in range(getattr(log, x).shape[1])]
    table, header = np.column_stack([log.t, log.q, log.v, log.u]), ",".join(["t", *names])
    np.savetxt(folder / "log.csv", table, delimiter=",", header=header, comments="")
    space, out = setup.plant.system.space, folder / "found"
    (folder / "sheet.toml").write_text(asset(name, "vehicle.toml").read_text(encoding="utf-8"))
    known = f"{space.names[0]}={float(truth[0])!r}"
    said = ["identify", "--model", str(folder / "sheet.toml"), "--log", str(folder / "log.csv")]
    assert command([*said, "--known", known, "--out", str(out), "--quiet"]) in {0, 1}
    found = json.loads((out / "identification.json").read_text(encoding="utf-8"))
    own = found["parameters"][: len(truth)]
    assert [p["name"] for p in own] == list(space.names)
    gains = np.array([own[i]["value"] for i in space.actuators]) / truth[space.actuators]
    told = [(p, x) for p, x in zip(own, truth, strict=True) if p["status"] == "identified"]
    sides = [(p, x, p["high"] if x > p["value"] else p["low"]) for p, x in told]
    off = np.array([(x - p["value"]) / (end - p["value"]) for p, x, end in sides])
    return Found(found, gains, off)


SLOW = pytest.mark.slow
FAMILIES = [
    ("bluerov2", 40.0, 0.005, 20),
    ("f1tenth", 60.0, 0.005, 6),
    ("catamaran", 120.0, 0.01, 9),
    pytest.param("hummingbird", 20.0, 0.01, 18, marks=SLOW),
    pytest.param("bmw320i", 60.0, 0.005, 6, marks=SLOW),
    pytest.param("remus100", 120.0, 0.1, 16, marks=SLOW),
    pytest.param("astrobee", 120.0, 0.05, 0, marks=SLOW),
]


@pytest.mark.parametrize("seed", [11, pytest.param(14, marks=SLOW)])
@pytest.mark.parametrize(("name", "seconds", "error", "count"), FAMILIES)
def test_a_log_of_each_family_gives_its_gains(tmp_path, name, seconds, error, count, seed):
    found = identified(tmp_path, name, seconds, seed=seed)
    ratios = found.gains / found.gains.mean()
    assert ratios == pytest.approx(np.ones(len(ratios)), abs=error)
    assert len(found.off) >= count and np.sum(found.off > 1) <= 0.1 * len(found.off)
    assert found.said["explains"] == ("partly" if name == "astrobee" else "yes")
    assert not currents(found)


def currents(found: Found) -> list[dict[str, Any]]:
    """The findings that blame a current or wind."""
    return [f for f in found.said["findings"] if "current or wind" in f["text"]]


def test_thrusters_may_lag(tmp_path):
    """The lag passed for a delay, and thrusts were 8 % off in intervals of ± 4 %."""
    found = identified(tmp_path, "bluerov2", 40.0, lag=0.1, delay=0.05)
    data = {f["code"]: f["data"] for f in found.said["findings"]}
    assert data["lag"]["seconds"] == pytest.approx(0.1, abs=0.01)
    assert found.said["joints"][0]["delay"] == pytest.approx(0.055, abs=0.005)  # held for 10 ms
    assert found.gains == pytest.approx(np.ones(8), abs=0.02)
    assert np.mean(found.off <= 1) >= 0.9


def test_a_current_is_told_and_widens_the_intervals_of_drag(tmp_path):
    found = identified(tmp_path, "bluerov2", 40.0, flow=(0.05, 0.0, 0.0))
    (finding,) = currents(found)
    assert finding["level"] == "warning" and found.said["explains"] == "partly"
    assert np.mean(found.off <= 1) >= 0.9


@pytest.mark.slow  # with one seed for each family above
def test_still_water_is_not_taken_for_a_current(tmp_path):
    found = identified(tmp_path, "bluerov2", 60.0, seed=15)
    assert not currents(found)


STRAIGHT = Driving(variation=0.55, grip=1e-6, ground=1e4)
POOR = {
    "an ROV that only surges": ("bluerov2", AxisMultisine(("surge",), low=0.1, high=1.0)),
    "an ROV that only heaves": ("bluerov2", AxisMultisine(("heave",), low=0.1, high=1.0)),
    "a car on a straight road": ("f1tenth", STRAIGHT),
    "a car at constant speed": ("f1tenth", replace(STRAIGHT, variation=0.01)),
    "a heavier car": ("bmw320i", replace(STRAIGHT, speed=20.0)),
}


@pytest.mark.parametrize(
    "motion",
    [x if x.startswith("a car") else pytest.param(x, marks=SLOW) for x in POOR],
)
def test_a_poor_motion_gives_no_narrow_and_wrong_interval(tmp_path, motion):
    name, excitation = POOR[motion]
    found = identified(tmp_path, name, 40.0, excitation)
    assert found.said["explains"] != "yes"
    assert np.all(found.off <= 2)
