"""An accelerometer that contradicts attitude and velocity is named, with what mends the map."""

from __future__ import annotations

import tomllib
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.checks import checked, checks
from nsaid_mj.clinic.logs.layout import FRD, NED
from nsaid_mj.clinic.logs.mapping import map_of
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.recordings import Recordings
from nsaid_mj.clinic.logs.remedies import mended, remedies
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from tests.court.field_causes import draw

ROBOT = load_robot_model("bluerov2")
G = 9.80665
PLACE = np.array([0.15, -0.08, 0.1])  # of the sensor [m]
FELT = ("ax", "ay", "az")

Table = dict[str, np.ndarray]


def parts(table: Table, names: tuple[str, ...]) -> np.ndarray:
    return np.column_stack([table[name] for name in names])


def turn_of(table: Table) -> Rotation:
    return Rotation.from_quat(parts(table, ("qx", "qy", "qz", "qw")))


def with_columns(table: Table, names: tuple[str, ...], values: np.ndarray) -> Table:
    return table | dict(zip(names, values.T, strict=True))


@lru_cache(maxsize=1)
def healthy() -> tuple[Table, str]:
    """A ROV's log whose accelerometer sits off the origin, has bias and noise; its map."""
    drawn = draw(3, "vehicle, healthy", "bluerov2")
    table = dict(drawn.tables[0])
    step = float(np.median(np.diff(table["t"])))
    turns = turn_of(table)
    width = np.ones(9) / 9  # velocities are noisy: their slopes would be noise

    def slope(x: np.ndarray) -> np.ndarray:
        smooth = np.array([np.convolve(np.convolve(c, width, "same"), width, "same") for c in x.T])
        return np.gradient(smooth.T, step, axis=0)

    rates = parts(table, ("p", "q", "r"))
    motion = slope(turns.apply(parts(table, ("vx", "vy", "vz"))))
    felt = turns.inv().apply(motion + G * np.array([0.0, 0.0, 1.0]))
    felt += np.cross(slope(rates), PLACE) + np.cross(rates, np.cross(rates, PLACE))
    felt += [0.05, -0.03, 0.04] + 0.05 * np.random.default_rng(0).normal(size=felt.shape)
    text = drawn.map.replace("[vehicle]\n", '[vehicle]\nacceleration = ["ax", "ay", "az"]\n')
    return with_columns(table, FELT, felt), text


def recorded(text: str, table: Table) -> Recordings:
    channels = {n: Channel(table["t"], x) for n, x in table.items() if n != "t"}
    return prepare([LogTable("log.csv", channels, 0)], map_of(tomllib.loads(text)), ROBOT)


def said(text: str, table: Table, level: str = "refusal") -> list[Finding]:
    found = checks(recorded(text, table), ROBOT)
    return [finding for finding in found if finding.level == level]


def test_an_accelerometer_that_follows_is_placed_and_does_not_enter_the_fit():
    table, text = healthy()
    assert said(text, table) == []
    (note,) = [f for f in said(text, table, "note") if f.code == "accelerometer_place"]
    np.testing.assert_allclose(note.data["place"], PLACE, atol=0.03)
    placed = text.replace("[vehicle]\n", f"[vehicle]\nacceleration_at = {note.data['place']}\n")
    assert not [f for f in said(placed, table, "note") if f.code == "accelerometer_place"]
    assert all(s.specific is None for s in checked(recorded(text, table), ROBOT).segments)


CHANGED = {
    "g": lambda f, _: f / G,
    "forward-right-down": lambda f, _: f @ FRD,
    "forward-right-down in g": lambda f, _: f @ FRD / G,
    "reversed": lambda f, _: -f,
    "sideways": lambda f, _: f[:, [1, 0, 2]],
}


@pytest.mark.parametrize("kind", CHANGED)
def test_axes_signs_and_unit_are_one_finding_whose_remedy_mends_the_log(kind):
    table, text = healthy()
    changed = with_columns(table, FELT, CHANGED[kind](parts(table, FELT), turn_of(table)))
    found = said(text, changed)
    assert [finding.code for finding in found] == ["accelerometer"]
    assert ("acceleration_unit" in found[0].remedy) == kind.endswith("g")
    assert said(mended(text, remedies(found)), changed) == []


def test_gravity_that_was_taken_out_is_named():
    table, text = healthy()
    still = turn_of(table).inv().apply([0.0, 0.0, G])
    changed = with_columns(table, FELT, parts(table, FELT) - still)
    assert said(text, changed) == []
    (finding,) = [f for f in said(text, changed, "warning") if f.code == "accelerometer"]
    assert "gravity is taken out" in finding.text


def test_a_sensor_of_something_else_is_a_warning():
    table, text = healthy()
    noise = np.random.default_rng(1).normal(size=(len(table["t"]), 3))
    changed = with_columns(table, FELT, noise)
    assert said(text, changed) == []
    (finding,) = [f for f in said(text, changed, "warning") if f.code == "accelerometer"]
    assert "under any axes" in finding.text


def test_frame_and_twist_are_found_together_where_no_position_tells():
    """The accelerometer reversed would fit nearly as well, and pass with wrong forces."""
    table, text = healthy()
    turns = turn_of(table)
    world = turns.apply(parts(table, ("vx", "vy", "vz"))) @ NED.T
    ned = Rotation.from_matrix(NED.T @ turns.as_matrix() @ FRD).as_quat()
    changed = with_columns(table, ("qx", "qy", "qz", "qw"), ned)
    changed = with_columns(changed, ("vx", "vy", "vz"), world)
    changed = with_columns(changed, ("p", "q", "r"), parts(table, ("p", "q", "r")) @ FRD)
    changed = with_columns(changed, FELT, parts(table, FELT) @ FRD)
    free = text.replace('position = ["x", "y", "z"]\n', "")
    (finding,) = said(free, changed)
    assert finding.data["map"] == {"vehicle.frame": "NED/FRD", "vehicle.twist": "world"}
    assert said(mended(free, remedies([finding])), changed) == []


@pytest.mark.parametrize(
    ("factor", "changes"),
    [
        (1.0, {}),
        (1 / G, {"vehicle.acceleration_unit": "g"}),
        (-1.0, {"vehicle.acceleration": ["-ax", "-ay", "-az"]}),
    ],
)
def test_without_velocities_gravity_tells_unit_and_sign(factor, changes):
    table, text = healthy()
    alone = text.replace('position = ["x", "y", "z"]\n', "")
    alone = alone.replace('linear = ["vx", "vy", "vz"]\n', "")
    found = said(alone, with_columns(table, FELT, factor * parts(table, FELT)))
    assert [f.data["map"] for f in found] == ([changes] if changes else [])
