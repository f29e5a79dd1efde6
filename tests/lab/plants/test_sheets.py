"""A vehicle.toml makes a plant, or an error that says what to correct."""

from __future__ import annotations

import copy
import math
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput, NsaidError, UnknownName
from nsaid_mj.lab.plants.vehicles import (
    AstrobeePlant,
    BlueROV2Plant,
    CarPlant,
    QuadrotorPlant,
    REMUS100Plant,
)
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.robots.assets import asset, published_numbers

FAMILIES: dict[str, Any] = {
    "bluerov2": BlueROV2Plant,
    "remus100": REMUS100Plant,
    "crazyflie": QuadrotorPlant,
    "f1tenth": CarPlant,
    "astrobee": AstrobeePlant,
}


def toml(value: Any, prefix: str = "") -> str:
    """A nested dict as TOML; only what data sheets have."""
    if isinstance(value, dict) and not prefix.endswith("="):
        plain = {k: v for k, v in value.items() if not isinstance(v, dict)}
        lines = [f"{k} = {_inline(v)}" for k, v in plain.items()]
        for k, v in value.items():
            if isinstance(v, dict):
                lines += [f"[{prefix}{k}]", toml(v, f"{prefix}{k}.")]
        return "\n".join(lines)
    return _inline(value)


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    return repr(value)


def places(value: Any, path: tuple = ()) -> list[tuple]:
    """The paths of all values in a data sheet, tables and lists among them."""
    inner = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [p for k, v in inner for p in ((*path, k), *places(v, (*path, k)))]


def made(family: str, content: Any) -> Any:
    """The plant of a data sheet, from a folder with the packed drawing."""
    config: type[PlantConfig] = FAMILIES[family]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "vehicle.toml").write_text(toml(content), encoding="utf-8")
        (folder / "model.xml").write_bytes(asset(family, "model.xml").read_bytes())
        return config(vehicle=str(folder)).build(1e-2, 3)  # type: ignore[call-arg]  # the class's


def changed(content: Any, path: tuple, new: Any) -> Any:
    content = copy.deepcopy(content)
    at = content
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = new
    return content


WRONG = st.one_of(
    st.floats(),
    st.integers(-(10**20), 10**20),
    st.sampled_from([0, 0.0, -1, 1e308, 5e-324, math.nan, -math.inf, True, "1.0", "", [], {}]),
    st.lists(st.floats(-1e3, 1e3), max_size=8),
)


def test_added_mass_that_is_not_physical_is_refused():
    """Hypothesis found it: a coupling that is a thousand times too large."""
    wrong = changed(published_numbers("remus100"), ("added_mass", "Y_rdot"), 1930.0)
    with pytest.raises(NsaidError, match="added mass"):
        made("remus100", wrong)


@pytest.mark.parametrize("family", FAMILIES)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_any_data_sheet_makes_a_plant_or_a_typed_error(family, data):
    content = published_numbers(family)
    for _ in range(data.draw(st.integers(1, 2))):
        path = data.draw(st.sampled_from(places(content)))
        deed = data.draw(st.sampled_from(["replace", "remove", "repeat", "scale", "add"]))
        at: Any = content
        for key in path[:-1]:
            at = at[key]
        if deed == "remove":
            del at[path[-1]]
        elif deed == "repeat" and isinstance(at[path[-1]], list) and at[path[-1]]:
            at[path[-1]] = at[path[-1]] + at[path[-1]][:1]
        elif deed == "scale" and isinstance(at[path[-1]], float):
            at[path[-1]] *= data.draw(st.sampled_from([-1, 0, 1e-9, 1e3, 1e6, 1e300]))
        elif deed == "add" and isinstance(at, dict):
            at[data.draw(st.sampled_from(["mas", "inertias", "x", "vehicle"]))] = 1.0
        else:
            at[path[-1]] = data.draw(WRONG)
    try:
        plant = made(family, content)
    except NsaidError as error:
        assert str(error)
    else:
        assert np.isfinite(plant.truth).all() and np.isfinite(plant.data.qpos).all()


SAMPLES = [
    ("bluerov2", ("mass",), -13.5, "mass: expected a number > 0 [kg], got -13.5"),
    ("bluerov2", ("mass",), "heavy", "mass: expected a number > 0 [kg], got 'heavy'"),
    ("bluerov2", ("volume",), math.nan, "volume: expected a number > 0 [m³], got nan"),
    ("bluerov2", ("inertia",), [0.2, 0.2], "got 2 values"),
    ("bluerov2", ("inertia",), [0.1, 0.1, 0.5], "less than the sum of the other two"),
    ("bluerov2", ("added_mass", 2), -18.68, "added_mass[3]: expected six numbers ≥ 0"),
    ("bluerov2", ("thrusters", "curve"), [1.0] * 6, "1 to 5 coefficients"),
    ("bluerov2", ("thrusters", "curve"), [-5.0], "a thrust > 0 N at full command"),
    ("bluerov2", ("thrusters", "rings", 0, "turns"), [0.0], "one for each of 4 angles"),
    ("bluerov2", ("thrusters", "rings", 0, "direction"), [1.0, 1.0, 0.0], "1.41421"),
    ("bluerov2", ("thrusters", "rings"), [], "at least one thruster"),
    ("bluerov2", ("ballast",), 131.454 - 132.435, "a net weight that is not 0"),
    ("bluerov2", ("guess",), 3.0, "guess: expected a table, got 3.0"),
    ("crazyflie", ("rotors", "spin", 1), 0.5, "1 or −1"),
    ("crazyflie", ("rotors", "places"), [[1, 1]], "two numbers for each of four rotors"),
    ("f1tenth", ("stiffness",), 4.7, "two numbers > 0, front and rear [1/rad]"),
    ("remus100", ("drag", "Y_vv"), 131.0, "drag.Y_vv: expected a number < 0"),
    ("remus100", ("net_weight",), 0, "not 0"),
    ("astrobee", ("nozzles", "directions"), [[1.0, 0.0, 0.0]], "one for each of 6 positions"),
]


@pytest.mark.parametrize("family, path, new, words", SAMPLES)
def test_an_error_names_file_key_expectation_and_what_came(family, path, new, words):
    with pytest.raises(InvalidInput) as caught:
        made(family, changed(published_numbers(family), path, new))
    assert words in str(caught.value)
    assert "vehicle.toml: " in caught.value.name and caught.value.remedy


def test_a_missing_key_is_named():
    content = published_numbers("bluerov2")
    del content["guess"]["speed"]
    with pytest.raises(InvalidInput, match=r"guess\.speed: expected six velocities .* got nothing"):
        made("bluerov2", content)


def test_all_missing_keys_are_told_at_once_with_values_that_load():
    """The values are those of the vehicle of the family that is nearest in mass."""
    content = {"kind": "quadrotor", "mass": 1.2, "rotors": {"arm": 0.25}}
    with pytest.raises(InvalidInput) as caught:
        made("crazyflie", content)
    said = str(caught.value)
    begin = said.partition("Values to begin from, of hummingbird: ")[2].partition(". docs/")[0]
    assert "rotors.top_speed (a number > 0 [rad/s])" in said and " mass (" not in said
    for line in begin.split("; "):
        key, _, value = line.partition(" = ")
        *tables, last = key.split(".")
        table = content["rotors"] if tables else content
        table[last] = tomllib.loads(f"value = {value}")["value"]
    made("crazyflie", content)


@pytest.mark.parametrize("path", [("linear_drg",), ("guess", "speeds"), ("thrusters", "curves")])
def test_an_unknown_key_is_refused_with_near_matches(path):
    with pytest.raises(UnknownName) as caught:
        made("bluerov2", changed(published_numbers("bluerov2"), path, 1.0))
    assert caught.value.name == path[-1] and "vehicle.toml" in caught.value.kind
    assert caught.value.near[0] in {"linear_drag", "speed", "curve"}


@pytest.mark.parametrize("content", [b"mass = ", b"\xff\xfe", b"mass = 1\nmass = 2"])
def test_a_file_that_is_no_toml_is_refused(tmp_path, content):
    (tmp_path / "own.toml").write_bytes(content)
    with pytest.raises(InvalidInput, match=r"own\.toml: expected a TOML file"):
        BlueROV2Plant(vehicle=str(tmp_path / "own.toml")).build(1e-2, 0)


def test_a_folder_without_vehicle_toml_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match=r"vehicle\.toml.*no such file"):
        BlueROV2Plant(vehicle=str(tmp_path)).build(1e-2, 0)


def test_trailing_zeros_of_a_thruster_curve_change_nothing():
    """Once, a curve of another length shifted the thrusters' numbers behind it."""
    content = published_numbers("bluerov2")
    for curve in ([8.9, 176.0], [8.9, 176.0, 0.0], [8.9, 176.0, 0.0, 0.0, 0.0]):
        p = made("bluerov2", changed(content, ("thrusters", "curve"), curve))
        with p.running():
            p.reset(np.zeros(6), np.zeros(6))
            for _ in range(20):
                p.step(np.full(8, 0.4))
            end = np.concatenate(p.coordinates())
        if len(curve) == 2:
            first = end
        assert (end == first).all() and np.abs(end).max() > 1e-4


@pytest.mark.parametrize("count", [1, 5, 6, 16])
def test_any_number_of_thrusters_up_to_16_is_exact(count):
    content = published_numbers("bluerov2")
    rng = np.random.default_rng(count)
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    content["thrusters"] = {
        "curve": [10.0, 30.0],
        "positions": rng.uniform(-0.2, 0.2, (count, 3)).tolist(),
        "directions": directions.tolist(),
    }
    p = made("bluerov2", content)
    assert p.system.n_u == count and p.system.p == 37 + count
    q, v, u = p.system.random_state(rng)
    with p.running():
        numbers_of_pose = np.r_[q[:3], np.zeros(3)]
        p.reset(numbers_of_pose, v)
        p.data.ctrl[:] = u
        import mujoco

        mujoco.mj_forward(p.model, p.data)
        a = p.joints.acceleration(p.data)
    W = p.system.regressor(0.0, np.r_[p.position(numbers_of_pose), v], v, a, u)
    assert np.abs(W @ p.truth).max() <= 1e-11 * np.abs(W * p.truth).max()
