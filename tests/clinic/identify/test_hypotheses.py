"""What the user tells is a hypothesis: contradicted, it is said first and takes no part."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.result import Identification
from tests.court.field_findings import Twin, Weight
from tests.support.robot_logs import two_joints

NAMES = ("base", "middle", "tip")
MASS = 0.8


@pytest.fixture(scope="module")
def twin() -> Twin:
    robot = two_joints(NAMES)
    for joint in range(1, robot.model.njoints):
        robot.model.addJointFrame(joint)
    return Twin(robot, 1, off=0.2, speed=0.8)


@pytest.fixture(scope="module")
def logs(twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """One log without a load, and one with it on the middle link."""
    folder = tmp_path_factory.mktemp("told")
    weight = Weight(MASS, 2, (0.3, 0.05, 0.0))
    free = twin.write(folder / "free.csv", number=0)
    return [free, twin.write(folder / "loaded.csv", number=1, weight=weight)]


DONE: dict[str, Identification] = {}


def fitted(twin: Twin, logs: list[Path], **told: object) -> Identification:
    """What is identified with what is told; the same once for all tests."""
    key = f"{len(logs)} {told}"
    if key not in DONE:
        DONE[key] = identify_forces(twin.robot, logs, columns=["viscous"], delay=0.01, **told)  # type: ignore[arg-type]
    return DONE[key]


def assert_said_first(found: Identification, twin: Twin) -> None:
    """The contradiction is the first finding and begins the verdict; nothing is wrong and firm."""
    assert found.findings[0].code == "contradicted" and found.explains == "partly"
    assert found.findings[0].text[5:] in found.verdict
    gains = found.of("motor gain")
    assert not [p.name for p in gains if p.status == "identified"]
    assert all(p.low <= twin.true[p.name] <= p.high for p in gains)


def test_what_is_right_is_not_doubted(twin, logs):
    for told in (
        {"loads": [f"loaded.csv:{MASS}kg@middle"]},
        {"known": {"gain_1": twin.true["gain_1"]}},
        {"known": {"gain_1": twin.true["gain_1"], "gain_2": 1.03 * twin.true["gain_2"]}},
        {"loads": [f"loaded.csv:{MASS}kg@middle"], "known": {"gain_3": twin.true["gain_3"]}},
    ):
        found = fitted(twin, logs, **told)
        assert found.explains == "yes" and "contradicted" not in {f.code for f in found.findings}
        assert np.sum([p.status == "identified" for p in found.of("motor gain")]) >= 1


@pytest.mark.parametrize(
    "told", ["loaded.csv:{}kg@tip", "loaded.csv:{}kg@base", "free.csv:{}kg@tip"]
)
def test_a_load_at_the_wrong_place_or_of_the_other_log_is_named_and_obeyed_ends_right(
    twin, logs, told
):
    found = fitted(twin, logs, loads=[told.format(MASS)])
    assert_said_first(found, twin)
    remedy = re.search(r"--load (\S+?)`", found.findings[0].remedy)
    assert remedy is not None and remedy[1] == f"loaded.csv:{MASS}kg@middle"
    obeyed = fitted(twin, logs, loads=[remedy[1]])
    assert obeyed.explains == "yes"
    gains = obeyed.of("motor gain")
    assert all(p.low <= twin.true[p.name] <= p.high and p.status == "identified" for p in gains)


@pytest.mark.parametrize("factor", [2.0, 0.5, 1000.0])
def test_a_known_gain_in_another_unit_contradicts_the_file(twin, logs, factor):
    found = fitted(twin, logs[:1], known={"gain_2": factor * twin.true["gain_2"]})
    assert_said_first(found, twin)
    assert ("thousand" in found.findings[0].text) == (factor == 1000)
    told = found.of("motor gain")[1]
    if factor < 5:  # the file may be wrong instead
        assert told.low <= 1.05 * factor * twin.true["gain_2"] and told.high > told.low


def test_of_two_known_gains_the_one_that_the_file_contradicts_is_left_out(twin, logs):
    known = {"gain_1": twin.true["gain_1"], "gain_2": 0.4 * twin.true["gain_2"]}
    found = fitted(twin, logs[:1], known=known)
    (said,) = [f for f in found.findings if f.code == "contradicted"]
    assert said.where == "gain of middle" and found.explains == "partly"
    status = {p.name: p.status for p in found.of("motor gain")}
    assert status["gain_1"] == "known" and status["gain_2"] != "known"


def test_two_known_gains_that_agree_overrule_the_masses_of_the_file(twin, logs):
    known = {name: 2.5 * twin.true[name] for name in ("gain_1", "gain_3")}
    found = fitted(twin, logs[:1], known=known)
    assert "contradicted" not in {f.code for f in found.findings}
    known = {name: 1000 * value / 2.5 for name, value in known.items()}
    assert fitted(twin, logs[:1], known=known).findings[0].code == "contradicted"


def test_a_load_of_another_mass_contradicts_the_file(twin, logs):
    found = fitted(twin, logs, loads=[f"loaded.csv:{3 * MASS}kg@middle"])
    assert_said_first(found, twin)
