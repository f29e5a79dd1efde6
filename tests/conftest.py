"""Fixtures and settings for all tests."""

import gc
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

gc.set_threshold(50_000)  # as the command line does
pytest.register_assert_rewrite("tests.support", "tests.recovery.direction")

DEAREST = (
    "cli/test_cli.py",
    "clinic/identify/test_identify.py",
    "clinic/identify/test_residuals.py",
    "clinic/logs/test_frames.py",
    "clinic/identify/test_scale.py",
    "clinic/identify/test_gears.py",
    "clinic/servos/test_menagerie.py",
    "clinic/servos/test_weighing.py",
    "court/test_court.py",
    "recovery/test_recovery.py",
    "contract/test_wall.py",
    "plans/studies/test_sweep.py",
    "faults/test_processes.py",
    "core/structure/test_compiled.py",
    "plans/baselines/test_baselines.py",
    "contract/test_identifiers.py",
    "lab/experiment/test_prior.py",
    "clinic/identify/test_hypotheses.py",
    "clinic/identify/test_payloads.py",
    "core/laws/test_cone.py",
    "core/laws/test_memory_law.py",
    "core/laws/test_never_wrong.py",
    "core/laws/test_bodies.py",
    "recovery/test_memory.py",
    "clinic/identify/test_flight.py",
    "clinic/identify/test_families.py",
    "lab/plants/test_aerial.py",
    "plans/excite/test_design.py",
    "clinic/servos/test_recovery.py",
    "clinic/servos/test_profiles.py",
    "faults/test_cache.py",
    "clinic/servos/test_comparison.py",
    "cli/test_servos.py",
    "clinic/servos/test_effects.py",
    "clinic/identify/test_live.py",
    "cli/test_exciting.py",
    "lab/control/test_adaptive_tracking.py",
    "faults/test_endings.py",
    "journeys/test_new_users.py",
    "test_examples.py",
    "test_readme.py",
    "test_your_vehicle.py",
    "test_docs.py",
    "cli/test_wheel.py",
)
"""Files that compile or simulate most. They are run first, so that the workers end together.

The first compiles most kernels; those behind it need few of them, so that the other worker does not
wait.
"""

DRAWN = (
    "report/",
    "cli/test_cli.py",
    "clinic/identify/test_identify.py",
    "clinic/identify/test_inspection.py",
    "faults/test_endings.py",
    "journeys/",
)
"""Tests whose pages are drawn: of every kind of result, and of runs that end early."""


def pytest_configure(config: pytest.Config) -> None:
    """Fewer examples where long studies are left out; other ones are drawn each time."""
    if "not slow" in config.option.markexpr:
        settings.register_profile("short", max_examples=25)
        settings.load_profile("short")


def pytest_collection_finish() -> None:
    """Leaves what is imported and collected out of every later search for cycles."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {Path(__file__).parent / name: k for k, name in enumerate(DEAREST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


@pytest.fixture(scope="module", autouse=True)
def drawings(request: pytest.FixtureRequest) -> Iterator[None]:
    """Pages draw nothing, but in tests that look at it: most of their time."""
    name = request.path.relative_to(Path(__file__).parent).as_posix()
    with pytest.MonkeyPatch.context() as patch:
        if not name.startswith(DRAWN):
            patch.setattr("nsaid_mj.report.drawings.draw", lambda panel: "<svg></svg>")
        yield


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draws nothing where pages are drawn otherwise: for tests that read the text."""
    monkeypatch.setattr("nsaid_mj.report.drawings.draw", lambda panel: "<svg></svg>")


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Linux machine without a screen."""
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
