"""A simulation runs ahead of the identifiers in a second thread, without changing the motion."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj import BlueROV2Plant, Loss, Scenario
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.log import Log
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.sensors import Errors, Sensors
from nsaid_mj.lab.setup import Setup
from nsaid_mj.lab.source import Simulation, SourceSegment

LENGTH = 100  # time steps of a segment


def noisy(name: str, steps: int = 350) -> Scenario:
    """A scenario with noisy sensors and a duration that is not a whole number of segments."""
    scenario = load(name)
    return replace(scenario, sensors="noisy", duration=steps * scenario.dt)


FAULTY = replace(noisy("bluerov2"), plant=BlueROV2Plant(faults=(Loss(0.4, actuator=3, time=1.5),)))
SCENARIOS = {
    "a compiled feedback": noisy("ur5"),
    "commands given in advance": noisy("bluerov2"),
    "a driver in Python": noisy("crazyflie"),
    "a fault within the second segment": FAULTY,
}


def segments(scenario: Scenario) -> tuple[list[SourceSegment], int]:
    """The segments of a run, and how many were simulated before the run asked for them."""
    setup, k, ahead = Setup.of(scenario), 0, 0
    moved = setup.plant, setup.driver(), setup.sensors()
    source = Simulation(*moved, scenario.dt, scenario.steps)
    with source.running():
        found = [source.begin()]
        while k < scenario.steps and not found[-1].end:
            ahead += source._next is not None
            last, steps = found[-1].log.at(-1), min(LENGTH, scenario.steps - k)
            found.append(source.segment(last, k, steps, setup.prior))
            k += len(found[-1].log.t) - 1
    return found, ahead


@pytest.mark.parametrize("name", SCENARIOS)
def test_simulating_ahead_does_not_change_the_motion(name: str) -> None:
    setup = Setup.of(SCENARIOS[name])
    with setup.plant.running():
        expected = setup.simulate()
    found, _ = segments(SCENARIOS[name])
    log = Log.joined(*(each.log.first(len(each.log.t) - 1) for each in found[1:-1]), found[-1].log)
    assert all(np.array_equal(a, b) for a, b in zip(log, expected, strict=True))


def test_compiled_motion_is_simulated_ahead() -> None:
    """All segments but the first; none where a driver in Python could share memory with a law."""
    assert segments(SCENARIOS["a compiled feedback"])[1] == 3
    assert segments(SCENARIOS["commands given in advance"])[1] == 3
    assert segments(SCENARIOS["a driver in Python"])[1] == 0
    assert segments(FAULTY)[1] < 3


def test_a_driver_that_uses_estimates_is_never_simulated_ahead_of_them() -> None:
    scenario = load("track_ur5")
    assert segments(replace(scenario, duration=350 * scenario.dt))[1] == 0


class Failing(Sensors):
    """Sensors whose velocities are not numbers from the third segment on."""

    calls = 0

    def errors(self, k: int, n: int) -> Errors:
        self.calls += 1
        errors = super().errors(k, n)
        return errors._replace(velocity=np.nan) if self.calls == 3 else errors


def test_a_failure_ahead_ends_the_run_at_its_own_segment(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = SCENARIOS["a compiled feedback"]
    sensors = Failing(scenario.noise, np.random.default_rng(0))
    monkeypatch.setattr(Setup, "sensors", lambda _: sensors)
    found, _ = segments(scenario)
    assert [each.end for each in found[:-1]] == [None] * 3
    assert found[-1].end == (Status.measurement_not_finite, "v")
    assert found[-1].log.t[-1] == pytest.approx((2 * LENGTH + 1) * scenario.dt)
