"""Gains of motors from targets and the known PD law of their controller."""

from nsaid_mj.clinic.identify.identify import identify
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
