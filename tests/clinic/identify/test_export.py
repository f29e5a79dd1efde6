"""The table of identified parameters as YAML."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.clinic.identify.export import write_parameters
from tests.support.identification import identification

yaml = pytest.importorskip("yaml")


def table_of(path, **changes):
    result = identification()
    first = replace(result.parameters[0], **changes)
    write_parameters(replace(result, parameters=(first,)), path)
    return result, first, yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_table_holds_values_units_intervals_and_the_anchor(tmp_path):
    result, mass, table = table_of(tmp_path / "a.yaml", low=-np.inf, high=np.inf, status="known")
    assert table["robot"] == result.robot.name and table["anchor"] == result.anchor
    assert table["notes"] == [result.verdict]
    assert table["parameters"] == [
        {
            "name": mass.label,
            "value": mass.value,
            "unit": mass.unit,
            "interval": [-np.inf, np.inf],
            "status": "known",
        }
    ]


@pytest.mark.parametrize("value", [1e-5, 1.5e-7, 1e22, -3.0, 0.1, 1e-300])
def test_numbers_keep_their_value(tmp_path, value):
    _, odd, table = table_of(tmp_path / "a.yaml", value=value, label='a "quoted": name #1')
    (row,) = table["parameters"]
    assert row["value"] == value and row["name"] == odd.label
