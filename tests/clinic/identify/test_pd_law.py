"""Gains of motors from targets and the known PD law of their controller."""

import pytest

from nsaid_mj.clinic.identify.identify import identify, identify_forces
from tests.court.field import numbers
from tests.court.field_commands import draw_pd


def test_gains_and_rotors_of_legs_are_covered(tmp_path):
    drawn = draw_pd(5, tmp_path, duration=10.0)
    found = identify(str(drawn.model), drawn.logs, mapping=drawn.map)
    assert found.explains in ("yes", "partly")
    own = {p.label: p for p in found.parameters}
    kinds = ("gain of", "rotor inertia of")
    inside = [
        own[label].low <= true <= own[label].high
        for label, true in drawn.truth.items()
        if label.startswith(kinds)
    ]
    assert sum(inside) >= len(inside) - 1
    assert abs(found.joints[0].delay - 0.01) < 0.002


@pytest.mark.slow
@pytest.mark.parametrize("seed", [340, 324], ids=["50 Hz", "jerky targets at 500 Hz"])
def test_friction_is_not_narrow_around_a_wrong_value(tmp_path, seed):
    """Viscous friction was .018 [.010, .032] for .080, and .52 [.42, .64] for .22."""
    drawn = draw_pd(seed, tmp_path)
    found = identify_forces(str(drawn.model), drawn.logs, mapping=drawn.map)
    assert numbers(found, drawn.truth).wrong == []


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "joint"), [(500, "FL_calf_joint"), (505, "FR_calf_joint")])
def test_friction_that_is_shaken_is_as_uncertain_as_its_split_is(tmp_path, seed, joint):
    """Viscous friction of the light joint was .58 (.43 to .79) for .22, .45 (.33 to .6) for .28."""
    drawn = draw_pd(seed, tmp_path)
    found = identify_forces(str(drawn.model), drawn.logs, mapping=drawn.map)
    own = {p.label: p for p in found.parameters}
    for kind in ("viscous", "Coulomb"):
        label = f"{kind} friction of {joint}"
        assert own[label].low <= drawn.truth[label] <= own[label].high
