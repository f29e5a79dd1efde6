"""Vehicles whose data sheet lists their forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, NsaidError, UnknownName
from nsaid_mj.lab.plants.listed import ListedPlant, ListedSheet
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.robots.assets import asset
from tests.support.fossen import published
from tests.support.vehicles import acceleration

TEXT = asset("catamaran", "vehicle.toml").read_text(encoding="utf-8")


def sheet(tmp_path: Path, old: str = "", new: str = "") -> ListedPlant:
    """The catamaran's sheet with a part replaced."""
    assert old in TEXT
    path = tmp_path / "vehicle.toml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    return ListedPlant(vehicle=str(path))


def by_hand(theta: np.ndarray, v: np.ndarray, u: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """(3,) v̇ of the catamaran, from its equations; `flow` (2,) is the water's, in its axes."""
    m11, m12, m13, m22, m23, m33, du, dv, dr, qv, qr, left, right, port, starboard = theta
    M = np.array([[m11, m12, m13], [m12, m22, m23], [m13, m23, m33]])
    rigid = np.diag([55.0, 55.0, 13.8])
    w = v - np.r_[flow, 0.0]
    x, y, r = w
    force = np.array([-du * x, -dv * y - qv * abs(y) * y, -dr * r - qr * abs(r) * r])
    for gain, command, side in ((left, u[0], 0.395), (right, u[1], -0.395)):
        thrust = gain * abs(command) * (command - 0.25 * (x - r * side))
        force += [thrust, 0.0, -side * thrust]
    for gain, angle in ((port, u[2]), (starboard, u[3])):
        lift = gain * abs(x) * (x * angle - (y - r))
        force += [0.0, lift, -lift]

    def coriolis(M: np.ndarray, v: np.ndarray) -> np.ndarray:
        px, py = (M @ v)[:2]
        return np.array([-v[2] * py, v[2] * px, v[0] * py - v[1] * px])

    added = M - rigid
    turned = v[2] * np.array([flow[1], -flow[0], 0.0])  # dν_c/dt = −ω × ν_c
    force += added @ turned - coriolis(rigid, v) - coriolis(added, w)
    return np.linalg.solve(M, force)


@pytest.mark.parametrize("flow", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.0)])
def test_a_listed_catamaran_moves_as_its_equations_say(flow):
    plant, rng = ListedPlant(mismatch=Mismatch(flow=flow)).build(1e-2, 3), np.random.default_rng(0)
    for _ in range(20):
        numbers, v = rng.uniform(-3, 3, 3), rng.uniform(-1.5, 1.5, 3)
        u = rng.uniform(-1, 1, 4)
        c, s = np.cos(numbers[2]), np.sin(numbers[2])
        own = np.array([c * flow[0] + s * flow[1], c * flow[1] - s * flow[0]])
        expected = by_hand(plant.truth, v, u, own)
        found = acceleration(plant, numbers, v, u)
        assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


def test_a_bluerov2_by_columns_is_the_bluerov2(tmp_path):
    """Its family's plant and the same forces listed have the same θ and the same motion."""
    known = published()
    lines = ['kind = "columns"', "mass = 13.5", "inertia = [0.26, 0.23, 0.37]"]
    lines += [f"added_mass = {np.diag(known.added).tolist()}", "size = [0.5, 0.4, 0.3]"]
    lines += ["speed = [1.0, 0.7, 0.7, 1.5, 1.5, 1.5]"]

    def column(kind: str, name: str, value: float, **others: object) -> None:
        lines.extend(["[[column]]", f'kind = "{kind}"', f'name = "{name}"', f"value = {value}"])
        lines.extend(f"{key} = {text}" for key, text in others.items())

    for kind, values in (("linear_drag", known.linear), ("drag", known.quadratic)):
        for i, value in enumerate(values):
            column(kind, f"axis {i}", value, guess=1.0, axes=np.eye(6)[i].tolist())
    column("weight", "the vehicle", known.net_weight)
    for i, value in enumerate(known.righting):
        column("righting", "xyz"[i], value, guess=1.0, axis=np.eye(3)[i].tolist())
    curve = np.zeros(2 * len(known.curve) - 1)
    curve[::2] = known.curve
    for i, thrust in enumerate(known.thrust):
        place, push = known.positions[i].tolist(), known.directions[i].tolist()
        column(
            "thruster",
            f"thruster {i + 1}",
            thrust,
            command=i + 1,
            point=place,
            direction=push,
            curve=curve.tolist(),
        )
    path = tmp_path / "vehicle.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    one, two = BlueROV2Plant().simulating(1e-2), ListedPlant(str(path)).simulating(1e-2)
    assert two.truth == pytest.approx(one.truth, rel=1e-12, abs=1e-12)
    rng = np.random.default_rng(1)
    for _ in range(5):
        numbers, v, u = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, 6), rng.uniform(-1, 1, 8)
        expected = acceleration(one, numbers, v, u)
        found = acceleration(two, numbers, v, u)
        assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()


def test_without_added_mass_the_ten_parameters_of_a_rigid_body_are_identified(tmp_path):
    old = TEXT[TEXT.index("plane = true") : TEXT.index("speed")]
    new = "mass = 2.0\ninertia = [0.1, 0.12, 0.15]\ncentre = [0.02, 0.0, -0.01]\ngravity = 9.81\n"
    plant = sheet(tmp_path, old, new).build(1e-2, 0)
    assert plant.system.space.names[:2] == ["m", "hx"]
    assert plant.truth[:4] == pytest.approx([2.0, 0.04, 0.0, -0.02])
    still = np.zeros(6)
    fall = acceleration(plant, still, still, np.zeros(4))
    assert fall == pytest.approx([0, 0, -9.81, 0, 0, 0], abs=1e-9)
    system, rng = plant.system, np.random.default_rng(2)
    q, v, u = system.random_state(rng)
    numbers = np.r_[rng.uniform(-1, 1, 3), 0.4, -0.2, 0.3]
    q = system.position(numbers)
    W = system.regressor(0.0, np.r_[q, v], v, acceleration(plant, numbers, v, u), u)
    assert np.abs(W @ plant.truth).max() <= 1e-12 * np.abs(W * plant.truth).max()


def test_columns_of_one_kind_and_name_share_their_parameter(tmp_path):
    shared = sheet(tmp_path, 'name = "the starboard rudder"', 'name = "the port rudder"')
    plant = shared.build(1e-2, 0)
    assert len(plant.truth) == len(ListedSheet.of("catamaran").blueprint().theta) - 1
    assert [len(block) for block in plant.system.space.blocks] == [6, 3, 2, 2, 1]


@pytest.mark.parametrize(
    "old,new,error,words",
    [
        ('kind = "fin"', 'kind = "fins"', UnknownName, "fin"),
        ('kind = "fin"', 'kind = "motor"', UnknownName, "kind of column on a body"),
        ("slip = 0.25  ", "slop = 0.25  ", UnknownName, "slop"),
        ("value = 26.0 ", "value = -26.0 ", InvalidInput, "Turn its direction"),
        ("value = 26.0 ", "", InvalidInput, "nominal value"),
        ("command = 3\n", "", InvalidInput, "Commands count from 1"),
        ("command = 3\n", "command = 0\n", InvalidInput, "from 1"),
        ("command = 3\n", f"command = {10**300}\n", InvalidInput, "to 1000"),
        ("point = [-1.0, 0.395, 0.0]", 'point = "aft"', InvalidInput, "a number, or several"),
        ("point = [-1.0, 0.395, 0.0]", "point = [1.0, 2.0]", InvalidInput, "3 numbers"),
        ("point = [-1.0, 0.395, 0.0]\n", "", InvalidInput, "point"),
        ("value = 137.5", "value = 0.0", InvalidInput, "guess"),
        ("plane = true", "plane = true\ngravity = 9.81", InvalidInput, "weight"),
        ("inertia = [8.9, 13.8, 13.8]", "inertia = [8.9, 13.8, 33.8]", InvalidInput, "sum"),
        ('kind = "columns"', 'kind = "colums"', InvalidInput, "columns"),
    ],
)
def test_a_wrong_sheet_says_what_to_correct(tmp_path, old, new, error, words):
    with pytest.raises(NsaidError, match=words) as caught:
        sheet(tmp_path, old, new).build(1e-2, 0)
    assert isinstance(caught.value, error)
