"""The table of what a log decides."""

from nsaid_mj.clinic.identify.choose.columns import COLUMNS, EXTRA, FASTENED, SPEEDS
from nsaid_mj.clinic.identify.choose.options import (
    CONSTANTS,
    CURVES,
    FALLING,
    FURTHER_COLUMNS,
    OPTIONS,
    SPEED,
)


def test_every_option_of_a_joint_is_one_of_its_columns_with_the_unit_of_its_parameter():
    for option in (*CURVES, FALLING, *CONSTANTS):
        assert option.unit == COLUMNS[option.name].unit[0] and option.adds == "θ"
    assert [option.name for option in FURTHER_COLUMNS] == list(EXTRA)


def test_a_friction_speed_is_a_constant_of_the_columns_that_depend_on_it():
    assert SPEED.values == SPEEDS
    assert {name for name, kind in COLUMNS.items() if "speed" in kind.constants} == FASTENED


def test_every_option_says_what_it_changes_and_when_it_is_taken():
    for option in OPTIONS:
        assert option.unit and option.criterion.worth >= 0
        assert option.values or option.adds in ("θ", "targets")
