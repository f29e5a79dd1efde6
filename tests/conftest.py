"""Fixtures and settings for all tests."""

import sys
from pathlib import Path

import pytest

pytest.register_assert_rewrite("tests.support", "tests.recovery.direction")

DEAREST = (
    "cli/test_cli.py",
    "court/test_court.py",
    "recovery/test_recovery.py",
    "studies/test_sweep.py",
    "contract/test_identifiers.py",
    "recovery/test_memory.py",
    "contract/test_wall.py",
    "contract/test_fault.py",
    "cli/test_servos.py",
    "calibration/servos/test_weighing.py",
    "contract/test_systems.py",
    "studies/test_montecarlo.py",
    "structure/test_compiled.py",
    "calibration/test_flight.py",
    "identifiers/test_faults.py",
    "identifiers/test_efficient.py",
    "cli/test_exciting.py",
    "studies/test_compare.py",
    "journeys/test_new_users.py",
    "design/test_design.py",
    "test_readme.py",
    "test_docs.py",
    "test_your_vehicle.py",
    "test_examples.py",
    "identifiers/test_cone.py",
    "control/test_adaptive_tracking.py",
    "baselines/test_baselines.py",
    "cli/test_wheel.py",
)
"""Files that compile or simulate most. They are run first, so that the workers end together."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {Path(__file__).parent / name: k for k, name in enumerate(DEAREST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Linux machine without a screen."""
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
