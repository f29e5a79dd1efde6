"""Springs, friction and gears that a model file does not have: found or named, and no others."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.identify.choose.columns import BASIC
from nsaid_mj.clinic.identify.export import write_models
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.models import load_robot_model
from tests.support.gears import GAIN, RIGID, Gear, log, mjcf, written
from tests.support.robot_logs import write_csv

KNOWN = {"gain_1": GAIN[0]}
OTHERS = ("elastic joint", "backlash")


def stiction(v, data):
    """Torques of dry friction that is twice as large while slow."""
    return np.array([4.0, 1.5]) * np.tanh(v / 0.02) * (1 + np.exp(-((v / 0.1) ** 2)))


def identified(folder: Path, seed: int = 0, gears=RIGID, drag=None, spring=0.0, rest=0.0, **more):
    """The result of a log; and whose residuals follow what, by joint."""
    text = mjcf(gears, spring, rest)
    file = write_csv(folder / "log.csv", log(text, gears, seed, drag))
    found = identify_forces(load_robot_model(str(written(folder))), file, known=KNOWN, **more)
    told = [f for f in found.findings if f.code == "residuals"]
    return found, {(f.where, words): f.text for f in told for words in OTHERS if words in f.text}


def size(text: str) -> float:
    """The number after "about"."""
    return float(text.split("about ")[1].split(maxsplit=1)[0])


TWISTS = {
    "elbow, its encoder on the motor": ("elbow", (Gear(), Gear(300.0)), 300),
    "elbow, its encoder on the link": ("elbow", (Gear(), Gear(300.0, load_side=True)), 300),
    "shoulder": ("shoulder", (Gear(2000.0), Gear()), 2000),
}


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=SLOW) if n == "shoulder" else n for n in TWISTS]
)
def test_an_elastic_joint_is_named_with_its_stiffness(tmp_path, name):
    joint, gears, stiffness = TWISTS[name]
    _, named = identified(tmp_path, gears=gears)
    assert list(named) == [(joint, "elastic joint")], named
    assert size(named[joint, "elastic joint"]) == pytest.approx(stiffness, rel=0.25)


@pytest.mark.parametrize(
    ("joint", "play", "seed"),
    [
        pytest.param("elbow", 0.02, 0, marks=SLOW),
        ("elbow", 0.005, 0),
        ("shoulder", 0.01, 1),
    ],
)
def test_backlash_behind_a_motors_encoder_is_named_with_its_size(tmp_path, joint, play, seed):
    own = Gear(play=play)
    gears = (own, Gear()) if joint == "shoulder" else (Gear(), own)
    _, named = identified(tmp_path, seed, gears=gears)
    assert list(named) == [(joint, "backlash")], named
    assert size(named[joint, "backlash"]) == pytest.approx(1e3 * play, rel=0.2)


def test_play_that_a_link_never_crosses_is_not_told(tmp_path):
    """In this log the shoulder's load keeps its sign, as MuJoCo's own gear joint shows."""
    assert not identified(tmp_path, 0, gears=(Gear(play=0.01), Gear()))[1]


def test_a_rigid_arm_has_neither(tmp_path):
    for seed in (3, 4):
        assert not identified(tmp_path, seed)[1]


@pytest.fixture(scope="module")
def sprung(tmp_path_factory):
    return identified(tmp_path_factory.mktemp("spring"), spring=20.0, rest=0.3)


def test_a_spring_is_found_with_its_rest_and_is_in_the_exported_model(sprung, tmp_path):
    found, named = sprung
    assert not named
    at = [p.name for p in found.parameters].index("stiffness_1")
    stiffness = found.parameters[at]
    assert stiffness.value == pytest.approx(20, rel=0.03) and stiffness.low > 15
    files, _ = write_models(found, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(next(f for f in files if f.suffix == ".xml")))
    shoulder = model.joint("shoulder")
    assert shoulder.stiffness[0] == pytest.approx(stiffness.value)
    assert shoulder.qpos_spring[0] == pytest.approx(0.3, abs=0.02)
    assert model.joint("elbow").stiffness[0] == 0


def test_the_intervals_of_a_spring_and_its_rest_hold_them(sprung):
    """A prior as narrow as the columns' guesses drew the spring to 0, by 2 %."""
    for name, true in (("stiffness_1", 20), ("offset_1", -6)):
        (one,) = [p for p in sprung[0].parameters if p.name == name]
        assert one.low <= true <= one.high and one.high - one.low < 0.05 * abs(true)


def test_a_spring_in_a_file_whose_angles_are_degrees_rests_where_it_does(tmp_path):
    degrees = mjcf().replace('<compiler angle="radian"/>', "")
    text = mjcf(spring=20.0, rest=0.3)
    file = write_csv(tmp_path / "log.csv", log(text, RIGID, 0))
    (tmp_path / "arm.xml").write_text(degrees, encoding="utf-8")
    found = identify_forces(load_robot_model(str(tmp_path / "arm.xml")), file, known=KNOWN)
    (tmp_path / "out").mkdir()
    files, _ = write_models(found, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(next(f for f in files if f.suffix == ".xml")))
    assert model.joint("shoulder").qpos_spring[0] == pytest.approx(0.3, abs=0.02)


def test_stribeck_friction_is_chosen_and_predicts_another_log_better(tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    validation = write_csv(other / "log.csv", log(mjcf(), RIGID, 7, stiction))
    found, _ = identified(tmp_path, 2, drag=stiction, validate=validation)
    plain, _ = identified(tmp_path, 2, drag=stiction, validate=validation, columns=BASIC)
    assert any("stribeck" in joint.columns for joint in found.joints)
    for rich, poor in zip(found.joints, plain.joints, strict=True):
        assert rich.validation and poor.validation
        assert rich.validation < 0.9 * poor.validation


def test_stribeck_friction_is_no_elastic_joint(tmp_path):
    """Friction changes within milliseconds where a joint turns: faster than the rows' filter."""
    found, named = identified(tmp_path, 2, drag=stiction)
    assert not named
    assert max(joint.held_out for joint in found.joints) < 0.006  # 0.009 from a slow velocity


CASES = [
    (case, seed)
    for case in ("rigid", "spring", "stiction", "play", "twist")
    for seed in range(10, 14)
]


@pytest.mark.slow
@pytest.mark.parametrize(("case", "seed"), CASES)
def test_chosen_columns_never_predict_worse_than_the_plain_ones(tmp_path, seed, case):
    options = {
        "rigid": {},
        "spring": {"spring": 20.0, "rest": 0.3},
        "stiction": {"drag": stiction},
        "play": {"gears": (Gear(), Gear(play=0.01))},
        "twist": {"gears": (Gear(), Gear(300.0))},
    }[case]
    other = tmp_path / "other"
    other.mkdir()
    text = mjcf(options.get("gears", RIGID), options.get("spring", 0.0), options.get("rest", 0.0))
    logged = log(text, options.get("gears", RIGID), seed + 100, options.get("drag"))
    validation = write_csv(other / "log.csv", logged)
    found, _ = identified(tmp_path, seed, validate=validation, **options)
    plain, _ = identified(tmp_path, seed, validate=validation, columns=BASIC, **options)
    errors = np.array([[j.validation for j in r.joints] for r in (found, plain)])
    assert np.log(errors[0] / errors[1]).mean() < 0.02
