import re

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.lab.plants.world.body import box_of
from nsaid_mj.robots.assets import asset
from nsaid_mj.robots.errors import BadRobot


def test_a_packed_vehicle_has_its_published_values():
    model = load_robot_model("hummingbird")
    assert model.kind == "vehicle" and model.model is None
    assert model.joints == ("rotor 1", "rotor 2", "rotor 3", "rotor 4")
    assert model.prior is not None and model.prior.shape == model.system.space.scale.shape
    assert model.prior[model.system.space.index("m")] == pytest.approx(0.5)


def test_a_vehicle_of_ones_own_is_recognised_by_its_numbers(tmp_path):
    text = asset("hummingbird", "vehicle.toml").read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("mass = 0.5 ", "mass = 0.7 "), encoding="utf-8")
    model = load_robot_model(str(path))
    assert (model.name, model.source) == ("mine", path)
    assert model.prior is not None
    assert model.prior[model.system.space.index("m")] == pytest.approx(0.7)
    path.write_text(text.replace("[rotors]", "[rotors]\nspare = 1"), encoding="utf-8")
    with pytest.raises(UnknownName, match="spare"):
        load_robot_model(str(path))
    path.write_text(text.replace("mass = 0.5 ", "mass = -1.0 "), encoding="utf-8")
    with pytest.raises(InvalidInput, match="mass"):
        load_robot_model(str(path))
    path.write_text(re.sub("kind = .*", "kind = [1]", text, count=1), encoding="utf-8")
    with pytest.raises(UnknownName, match="kind of vehicle"):
        load_robot_model(str(path))


def test_a_vehicles_prior_is_the_same_each_time():
    one, two = load_robot_model("hummingbird").prior, load_robot_model("hummingbird").prior
    assert one is not None and two is not None and np.array_equal(one, two)


def test_what_cannot_be_identified_is_refused():
    with pytest.raises(BadRobot, match="only be simulated"):
        load_robot_model("rover")
    with pytest.raises(InvalidInput, match="lock"):
        load_robot_model("hummingbird", lock=["rotor 1"])


def test_a_sheet_needs_no_picture(tmp_path):
    """Without a model.xml and a size a solid box of the body's inertia is drawn."""
    text = asset("hummingbird", "vehicle.toml").read_text(encoding="utf-8")
    assert "size" not in text
    (tmp_path / "quad.toml").write_text(text)
    assert len(load_robot_model(str(tmp_path / "quad.toml")).joints) == 4
    sides = np.array([0.5, 0.3, 0.1])
    inertia = 2.0 / 12 * np.diag((sides**2).sum() - sides**2)
    np.testing.assert_allclose(box_of(2.0, inertia), sides)
