"""A ship in a zig-zag at constant thrust: what manoeuvring adds to its sheet is found."""

import json
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.clinic.identify.choose.columns import (
    MANOEUVRES,
    further_columns,
    further_names,
    offered,
)
from nsaid_mj.clinic.identify.identify import identify
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.rows import with_columns

SHEET = """\
kind = "columns"
plane = true
mass = {mass}
inertia = [10.0, {turning}, {turning}]
added_mass = [{ahead}, {aside}, 0.0, 0.0, 0.0, {about}]
speed = [1.5, 0.2, 0.0001, 0.0001, 0.0001, 0.2]
size = [4.0, 0.8, 0.4]
"""
SURGE, SWAY, YAW = ([float(k == axis) for k in range(6)] for axis in (0, 1, 5))
STERN = {"point": [-1.9, 0.0, 0.0]}
COLUMNS = {
    "surge": {"kind": "drag", "axes": SURGE},
    "sway": {"kind": "linear_drag", "axes": SWAY},
    "yaw": {"kind": "linear_drag", "axes": YAW},
    "thrust": {"kind": "propeller", "command": 1, "slip": 0.25, "direction": [1, 0, 0], **STERN},
    "rudder": {"kind": "fin", "command": 2, "direction": [0, 1, 0], **STERN},
}
MAP = """
[vehicle]
position = ["x", "y", "psi"]
linear = ["u", "v", "r"]
[actuators]
"thrust" = { column = "n" }
"rudder" = { column = "delta" }
"""
STEP = 0.05


def _ship(seed: int, folder: Path) -> tuple[Path, Path, Path]:
    """Sheet, log and map of a ship whose hull turns and drifts as its sheet does not say."""
    rng = np.random.default_rng([seed, 5])
    length, mass, beam_force = 4.0, 500.0, 640.0  # beam_force: ½ ρ L d
    turning = mass * (0.25 * length) ** 2
    M = np.array([1.05 * mass, 1.8 * mass, 1.7 * turning])
    size = beam_force * length ** np.array([0, 1, 1, 2, 0, 3, 1])
    shape = np.array([0.3, -0.06, 0.09, 0.05, 0.8, 0.02, -0.15])
    y_v, y_r, n_v, n_r, y_vv, n_rr, x_vr = size * shape * rng.uniform(0.7, 1.3, 7)
    surge = 0.02 * beam_force
    thrust = surge * 1.5**2 / (0.8 * (0.8 - 0.25 * 1.5))
    rudder = 0.07 * beam_force

    def slope(nu, delta):
        u, v, r = nu
        side = rudder * abs(u) * (u * delta - (v - 1.9 * r))
        force = np.array(
            [
                thrust * 0.8 * (0.8 - 0.25 * u) - surge * abs(u) * u - x_vr * v * r,
                side - y_v * u * v - y_r * u * r - y_vv * abs(v) * v,
                -1.9 * side - n_v * u * v - n_r * u * r - n_rr * abs(r) * r,
            ]
        )
        coriolis = np.array([-M[1] * v * r, M[0] * u * r, (M[1] - M[0]) * u * v])
        return (force - coriolis) / M

    nu = np.array([1.5, 0.0, 0.0])
    pose = np.zeros(3)
    delta = 0.0
    goal = -0.3
    rows = []
    for k in range(round(200.0 / STEP)):
        goal = 0.3 if pose[2] > 0.3 else -0.3 if pose[2] < -0.3 else goal
        delta += np.clip(goal - delta, -0.3 * STEP, 0.3 * STEP)
        if k % 2 == 0:
            rows.append([k * STEP, *pose, *nu, 0.8, delta])
        middle = nu + 0.5 * STEP * slope(nu, delta)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        pose = pose + STEP * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ middle
        nu = nu + STEP * slope(middle, delta)
    log = np.array(rows)
    noise = np.array([0.02, 0.02, 2e-3, 5e-3, 5e-3, 1e-3])
    log[:, 1:7] += noise * rng.standard_normal((len(log), 6))
    table = folder / "zigzag.csv"
    np.savetxt(table, log, delimiter=",", header="t,x,y,psi,u,v,r,n,delta", comments="")
    guess = rng.uniform(0.8, 1.25, 8)
    numbers = np.array([M[0] - mass, M[1] - mass, M[2] - turning, surge, 1.5 * y_v, 1.5 * n_r])
    keys = ("ahead", "aside", "about", "surge", "sway", "yaw", "thrust", "rudder")
    own = dict(zip(keys, np.r_[numbers, thrust, rudder] * guess, strict=True))
    sheet = folder / "ship.toml"
    text = SHEET.format(mass=mass, turning=turning, **own)
    for name, column in COLUMNS.items():
        entries = {"name": name, "value": own[name]} | column
        lines = [f"{key} = {json.dumps(value)}" for key, value in entries.items()]
        text += "\n".join(["[[column]]", *lines, ""])
    sheet.write_text(text, encoding="utf-8")
    mapping = folder / "map.toml"
    mapping.write_text(MAP, encoding="utf-8")
    return sheet, table, mapping


@pytest.mark.parametrize("delay", [0.0, pytest.param(None, marks=pytest.mark.slow)])
def test_a_zigzag_at_constant_thrust_is_explained(tmp_path, delay):
    sheet, log, mapping = _ship(1, tmp_path)
    found = identify(str(sheet), [log], mapping=mapping, delay=delay)
    surge, sway, yaw = found.joints
    assert sway.columns == ("manoeuvring",)
    assert max(sway.held_out, yaw.held_out) < 0.1
    assert np.isnan(surge.held_out)
    codes = {finding.code for finding in found.findings}
    assert "coasts" in codes
    assert not codes & {"clock_offset", "added_mass", "hardly_moved"}
    own = {p.label: p for p in found.parameters}
    assert not any(p.status == "identified" for p in own.values())
    for label in ("effective sway mass", "effective yaw inertia"):  # the sheet's remain possible
        assert own[label].low <= own[label].prior <= own[label].high


def test_the_columns_are_products_of_the_velocities():
    system = load_robot_model("catamaran").system
    assert offered(system, "manoeuvring")
    assert not offered(load_robot_model("f1tenth").system, "manoeuvring")
    names = further_names(system, "manoeuvring")
    places = {name: system.p + k for k, name in enumerate(names)}
    columns = list(further_columns(system, frozenset({"manoeuvring"}), places))
    whole = with_columns(system, columns, [], system.p + len(names))
    u, v, r = 1.3, 0.01, -0.3
    twist = np.array([[u, v, r]])
    none = np.zeros((1, 3))
    W = whole.regressor(np.zeros(1), np.hstack([none, twist]), twist, none, np.zeros((1, 4)))
    values = {"u v": u * v, "u r": u * r, "v v": abs(v) * v, "r r": abs(r) * r}
    for (product, _, row, _), name in zip(MANOEUVRES, names, strict=True):
        force = np.zeros(3)
        force[row] = values[product]
        if (product, row) == ("u v", 2):
            force = -force  # a lift behind the origin turns the nose into the flow
        np.testing.assert_allclose(W[0, :, places[name]], force, atol=1e-4)
