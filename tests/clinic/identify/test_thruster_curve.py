"""Thrusters whose force follows another curve over the command than the sheet's."""

import numpy as np
import pytest

from nsaid_mj.clinic.identify.choose.thruster_curve import (
    ThrusterCurve,
    curve_values,
    flight_controllers_share,
)
from nsaid_mj.clinic.identify.identify import identify
from nsaid_mj.core.structure.parts import Column
from tests.court.field_commands import draw_constant, draw_curve

U = np.linspace(-1.0, 1.0, 41)


def test_a_dead_zone_an_exponent_and_a_weaker_reverse_are_found(tmp_path):
    drawn = draw_curve(6, tmp_path, duration=20.0)
    found = identify(str(drawn.model), drawn.logs)
    (note,) = [f for f in found.findings if f.code == "thruster_curve"]
    for name in ("dead zone", "exponent", "reverse"):
        low, high = note.data[name][1:]
        assert low <= drawn.truth[name] <= high
        assert high - low < 0.1
    ratios = np.array([p.value / drawn.truth[p.label] for p in found.gains])
    assert np.abs(ratios / ratios.mean() - 1).max() < 0.01
    assert max(j.held_out for j in found.joints) < 0.05
    assert "MOT_THST_EXPO = THR_MDL_FAC" in note.text


def test_the_sheets_curve_is_kept_where_it_is_true(tmp_path):
    drawn = draw_constant(1, tmp_path, 15.0, "bluerov2")  # one thruster at a constant command
    found = identify(str(drawn.model), drawn.logs)
    assert "thruster_curve" not in {f.code for f in found.findings}


def test_a_curve_of_numbers():
    square = Column.polynomial(0.0, 2.0)
    np.testing.assert_allclose(curve_values(square, U), 2 * U * np.abs(U))
    table = Column.interpolated(np.array([-1.0, 0.0, 1.0]), np.array([-1.0, 0.0, 3.0]))
    np.testing.assert_allclose(curve_values(table, U), np.where(U < 0, U, 3 * U))
    own = ThrusterCurve(0.1, 2.0, 0.9).shares(U, square)
    assert (own[np.abs(U) <= 0.1] == 0).all() and own[-1] == 2.0 and own[0] == pytest.approx(-1.8)
    np.testing.assert_allclose(ThrusterCurve().shares(U, square), curve_values(square, U))
    np.testing.assert_allclose(ThrusterCurve().as_sheets(U, square), U, atol=1e-6)
    curve = ThrusterCurve(0.0, 1.5, 0.8)
    inner = curve_values(square, curve.as_sheets(U, square))
    np.testing.assert_allclose(inner, curve.shares(U, square), atol=1e-4)


@pytest.mark.parametrize(("exponent", "share"), [(1.0, 0.0), (2.0, 1.0)])
def test_the_share_that_flight_controllers_ask_for(exponent, share):
    assert flight_controllers_share(ThrusterCurve(0.0, exponent)) == pytest.approx(share, abs=1e-9)
