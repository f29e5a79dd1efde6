"""A weighed load fixes the scale of masses, gains and friction; what is stated of it is checked."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.links import carrier, check_loads, payloads, with_mass
from nsaid_mj.clinic.identify.loads import Load, load_of
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.result import Identification
from nsaid_mj.robots.assets import asset
from tests.support.simulated_logs import HeavyWrist

MASS, CENTRE = 2.0, np.array([0.04, -0.02, 0.12])
OPTIONS = {"columns": ["viscous"], "delay": 0.012}


@pytest.fixture(scope="module")
def arm() -> HeavyWrist:
    return HeavyWrist("ur5", 0, 15.0)


@pytest.fixture(scope="module")
def logs(arm, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("load")
    free, loaded = arm, arm.loaded(1, MASS, CENTRE)
    return [free.write(folder / "free.csv"), loaded.write(folder / "loaded.csv")]


@pytest.fixture(scope="module")
def found(arm, logs) -> Identification:
    return identify_forces(arm.robot, logs, loads=[f"loaded.csv:{MASS}kg"], **OPTIONS)


def test_a_load_fixes_the_gains_of_an_arm(arm, logs, found):
    assert found.explains == "yes" and "mass of payload = 2" in found.anchor
    gains, true = found.of("motor gain")[:3], arm.gain
    for gain, k in zip(gains, true, strict=False):
        assert gain.low <= k <= gain.high and gain.status == "identified"
    off = np.mean([np.log(g.value / k) for g, k in zip(gains, true, strict=False)])
    assert abs(off) < 0.03
    own = {p.label: p for p in found.parameters if p.block == "payload"}
    assert own["mass of payload"].value == MASS and own["mass of payload"].status == "known"
    for axis, c in zip("xyz", CENTRE, strict=True):
        assert own[f"m·c{axis} of payload"].value == pytest.approx(MASS * c, abs=0.02)
    free = identify_forces(arm.robot, logs[:1], **OPTIONS)
    gain, other = found.of("motor gain")[0], free.of("motor gain")[0]
    assert gain.high / gain.low < 1.15
    assert other.high / other.low > 2


def test_a_load_whose_place_is_known_has_no_parameter_left(arm, logs):
    place = ",".join(str(x) for x in CENTRE)
    text = f"loaded.csv:2000g@{arm.robot.joints[-1]}:{place}"
    found = identify_forces(arm.robot, logs, loads=[text], **OPTIONS)
    own = [p for p in found.parameters if p.block == "payload"]
    assert [p.status for p in own[:4]] == ["known"] * 4
    assert own[1].value == pytest.approx(MASS * CENTRE[0])
    gain = found.of("motor gain")[0]
    assert gain.low <= arm.gain[0] <= gain.high and gain.high / gain.low < 1.15


def test_a_wrong_mass_moves_the_scale_by_its_own_factor(arm, logs, found):
    wrong = identify_forces(arm.robot, logs, loads=["loaded.csv:3kg"], **OPTIONS)
    ratio = [
        b.value / a.value
        for a, b in zip(*(r.of("motor gain")[:3] for r in (found, wrong)), strict=True)
    ]
    np.testing.assert_allclose(ratio, 1.5, rtol=0.03)


@pytest.mark.parametrize(
    "text,load",
    [
        ("a.csv:0.25kg", Load("a.csv", 0.25)),
        ("dir/a.csv:250 g@hand", Load("a.csv", 0.25, "hand")),
        ("C:\\logs\\a.csv:1e-1", Load("a.csv", 0.1)),
        ("a.csv:2kg@tool0:0.1,0,-.2", Load("a.csv", 2.0, "tool0", (0.1, 0.0, -0.2))),
    ],
)
def test_a_load_is_stated_in_one_word(text, load):
    assert load_of(text) == load


@pytest.mark.parametrize(
    "text",
    [
        "a.csv",
        "a.csv:",
        "a.csv:0kg",
        "a.csv:-1kg",
        "a.csv:1lb",
        "a.csv:1kg@x:1,2",
        ":1kg",
        "a.csv:1kg@x:1,2,nan",
        "a.csv:1e300kg",
    ],
)
def test_what_is_no_load_is_refused(text):
    with pytest.raises(InvalidInput, match="--load"):
        load_of(text)


def test_a_load_belongs_to_one_log_of_several():
    load = Load("b.csv", 1.0)
    check_loads([load], ["a.csv", "b.csv"])
    with pytest.raises(InvalidInput, match="the name of a log"):
        check_loads([load], ["a.csv"])
    with pytest.raises(InvalidInput, match="no load"):
        check_loads([load], ["b.csv", "b.csv"])


def test_a_gripper_is_passed_over_and_a_link_is_found_by_any_of_its_names():
    model = load_robot_model(str(asset("so101", "so101.xml"))).model
    assert carrier(model, Load("a", 1.0))[0] == carrier(model, Load("a", 1.0, "gripper"))[0] == 5
    assert carrier(model, Load("a", 1.0, "moving_jaw_so101_v1"))[0] == 6
    joint, centre, known = carrier(model, Load("a", 1.0, "wrist_flex", (0.0, 0.0, 0.1)))
    assert joint == 4 and known
    np.testing.assert_allclose(centre, [0, 0, 0.1], atol=1e-12)
    with pytest.raises(UnknownName, match="bottle"):
        carrier(model, Load("a", 1.0, "bottle"))


def test_the_weight_of_a_load_is_that_of_a_mass_on_a_lever():
    model = load_robot_model(str(asset("so101", "so101.xml"))).model
    heavy = with_mass(model, 5, 0.2, np.array([0.0, 0.0, -0.1]))
    rng = np.random.default_rng(0)
    for q in rng.uniform(-1, 1, (5, 6)):
        data = model.createData()
        added = pin.computeGeneralizedGravity(heavy, heavy.createData(), q)
        added = added - pin.computeGeneralizedGravity(model, data, q)
        J = pin.computeFrameJacobian(
            model, data, q, model.getFrameId("gripper", pin.FrameType.BODY), pin.LOCAL
        )
        pin.forwardKinematics(model, data, q)
        place = data.oMi[5].rotation.T @ np.array([0, 0, 9.81])
        wrench = 0.2 * np.r_[place, np.cross([0, 0, -0.1], place)]
        np.testing.assert_allclose(added, J.T @ wrench, atol=1e-9)


def test_loads_of_one_mass_and_place_are_one():
    model = load_robot_model("tx40").model
    found = payloads(model, [Load("a", 1.0), Load("b", 1.0), Load("c", 2.0, "link_5")])
    assert [sorted(p.sources) for p in found] == [["a", "b"], ["c"]]
    assert found[0].known == {"mass of payload_1": 1.0} and found[1].place == slice(40, 50)


def test_friction_is_judged_with_the_load_that_the_robot_carries(arm, logs):
    """Without the load's own columns its weight is left over: 63 % instead of 2.5 %."""
    options = {"columns": ["viscous", "coulomb"], "delay": 0.012}
    found = identify_forces(arm.robot, logs, loads=[f"loaded.csv:{MASS}kg"], **options)
    errors = [float(str(f.data["held_out"])) for f in found.findings if f.code == "columns"]
    assert errors and max(errors) < 0.05
