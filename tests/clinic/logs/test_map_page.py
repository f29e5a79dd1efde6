"""docs/map.md states the fields, units and codes that there are."""

import re
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest

from nsaid_mj.clinic.logs import mapping as m
from nsaid_mj.clinic.logs.mapping import map_of

PAGE = (Path(__file__).parents[3] / "docs" / "map.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS)
def test_examples_are_maps(block):
    assert map_of(tomllib.loads(block)) != m.Map()


@pytest.mark.parametrize(
    "part",
    [
        m.Map,
        m.Time,
        m.File,
        m.Joint,
        m.Profile,
        m.ColumnMap,
        m.MotorCoupling,
        m.Pd,
        m.Vehicle,
        m.Battery,
        m.Phases,
        m.Imu,
        m.ContactMap,
    ],
    ids=lambda p: p.__name__,
)
def test_every_field_is_in_an_example(part):
    assert [f.name for f in fields(part) if f.name not in "".join(BLOCKS)] == []


def test_every_unit_is_listed():
    known = {unit for factors in m.FACTORS.values() for unit in factors}
    assert [unit for unit in known if unit not in PAGE] == []
