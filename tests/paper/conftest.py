"""Fixtures: the systems on which the equations are tested."""

from __future__ import annotations

import pytest

from tests.support.bench import ARMS, BENCHES, Bench, bench


@pytest.fixture(params=list(BENCHES))
def table(request: pytest.FixtureRequest) -> Bench:
    """Every system in turn."""
    return bench(request.param)


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> Bench:
    """Every arm in turn."""
    return bench(request.param)
