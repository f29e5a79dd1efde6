"""Vehicles of which one command never moves: its force is a constant, and no reason to refuse."""

import pytest

from nsaid_mj.clinic.identify.identify import identify
from tests.court import field_commands

CAR_GAINS = ("drive gain",)


def _found(monkeypatch, tmp_path, vehicle, actuator, command, duration=15.0):
    monkeypatch.setitem(field_commands._STEERED, vehicle, (actuator, command))
    drawn = field_commands.draw_constant(1, tmp_path, duration, vehicle)
    found = identify(str(drawn.model), drawn.logs)
    return found, {p.label: p for p in found.parameters}, drawn.truth


def test_a_constant_thruster_is_a_constant_force(monkeypatch, tmp_path):
    found, own, truth = _found(monkeypatch, tmp_path, "bluerov2", 4, 0.3)
    label = "thrust of thruster 5"
    assert ("constant_command", "thruster 5") in [(f.code, f.where) for f in found.findings]
    assert own[label].status == "only in combination"
    assert "any other constant force" in own[label].combination
    assert own[label].low <= truth[label] <= own[label].high
    assert own[label].high / own[label].low < 10.0
    others = [own[name].value / true for name, true in truth.items() if name.startswith("thrust")]
    others.pop(4)
    assert max(others) / min(others) == pytest.approx(1.0, abs=0.02)


def test_a_thruster_that_is_off_keeps_the_sheets_gain(monkeypatch, tmp_path):
    found, own, _ = _found(monkeypatch, tmp_path, "bluerov2", 4, 0.0)
    assert ("zero_command", "thruster 5") in [(f.code, f.where) for f in found.findings]
    assert own["thrust of thruster 5"].status == "not excited"
    assert own["thrust of thruster 1"].relative < 0.1


def test_the_only_motor_at_a_constant_command_does_not_run_away(monkeypatch, tmp_path):
    _, own, truth = _found(monkeypatch, tmp_path, "f1tenth", 0, 0.4)
    for label in CAR_GAINS:
        assert own[label].low <= truth[label] <= own[label].high
        assert own[label].value == pytest.approx(truth[label], rel=0.5)
