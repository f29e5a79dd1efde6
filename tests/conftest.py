"""Fixtures and settings for all tests."""

import sys

import pytest

pytest.register_assert_rewrite("tests.support", "tests.recovery.direction")


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Linux machine without a screen."""
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
