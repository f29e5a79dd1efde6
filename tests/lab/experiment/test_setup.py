"""Driver, sensors and held-out motion are drawn from streams of their own."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Seeds, Setup

SETUP = Setup.of(replace(load("scalar_rov"), sensors="noisy", duration=1.0, held_out=1.0))


def drawn() -> dict[str, np.ndarray]:
    """The commands of the run and of the held-out motion, and the errors of the sensors."""
    with SETUP.plant.running():
        run = SETUP.simulate()
    held_out = SETUP.held_out(as_at=0.0)
    assert held_out is not None
    errors = SETUP.sensors().errors(5, SETUP.system.n)
    return {"excitation": run.u, "held_out": held_out.u, "sensors": errors.normal}


@pytest.mark.parametrize("name", ["excitation", "held_out", "sensors"])
def test_another_stream_changes_what_is_drawn_from_it_and_nothing_else(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = drawn()
    other = Seeds.of(SETUP.scenario.seed)._replace(**{name: np.random.SeedSequence(12345)})
    monkeypatch.setattr(Setup, "seeds", other)
    after = drawn()
    changed = {each for each in before if not np.array_equal(before[each], after[each])}
    assert changed == {name}


def test_the_held_out_motion_is_not_the_runs() -> None:
    found = drawn()
    run, held_out = found["excitation"][1:500], found["held_out"][1:500]
    assert np.abs(run - held_out).mean() > 0.3 * np.abs(run).mean()
