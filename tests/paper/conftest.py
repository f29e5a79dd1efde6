"""Fixtures: the systems on which the equations are tested."""

from __future__ import annotations

import pytest

from nsaid_mj.core.log import Measurement
from nsaid_mj.core.parameters import Array
from tests.support.bench import ARMS, BENCHES, Bench, bench, estimates


@pytest.fixture(params=list(BENCHES))
def table(request: pytest.FixtureRequest) -> Bench:
    """Every system in turn."""
    return bench(request.param)


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> Bench:
    """Every arm in turn."""
    return bench(request.param)


@pytest.fixture(scope="session")
def converged() -> tuple[Bench, list[Measurement], Array, Array]:
    """A run of the vehicle (16), well excited: table, samples, v̂ (N, 1), θ̂ (N, 4)."""
    table = bench("scalar_rov")
    samples = table.drive(100.0)
    law = table.law.build(table.system, table.prior(0.5), table.dt)
    return table, samples, *estimates(law, samples)
