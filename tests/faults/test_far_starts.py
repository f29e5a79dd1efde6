"""The cone's laws keep θ̂ physical from priors wrong by e^{±1} … e^{±3}, also in discrete time."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj import NullspaceAID
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.cone.law import ACCURACY
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier
from nsaid_mj.core.quotient.cone import Cone
from nsaid_mj.lab.following import Following
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup


def followed(
    name: str, law: str, error: float, seed: int, seconds: float
) -> tuple[Setup, Following]:
    """A run from a prior within e^{±error}: the setup, and its identifier at the end."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    scenario = replace(
        scenario,
        identifier=replace(scenario.identifier, law=law, gamma="scale"),
        rivals={},
        initial_error=error,
        gain_error=None,
        seed=seed,
        duration=seconds,
    )
    setup = Setup.of(scenario)
    with setup.plant.running():
        log = setup.simulate()
    assert log.t[-1] == pytest.approx(seconds), "the plant diverged"
    following = Following(setup.identifiers()[""], log)
    every = np.arange(25, len(log.t), 25)
    following.follow(log, every)
    return setup, following


FAR = [("memory", 1.0, 3), ("cone", 1.0, 3), ("memory", 2.0, 211), ("cone", 2.0, 213)]
FAR += [("memory", 3.0, seed) for seed in (3, 101, 213)]


@pytest.mark.parametrize(("law", "error", "seed"), FAR)
def test_no_start_is_lost_with_exact_sensors(law, error, seed):
    setup, following = followed("ur5", law, error, seed, 1.0)
    state = following.state
    assert following.ended is None and state.status is Status.completed
    assert following.drift < 1e-5
    assert Cone.of(setup.system.space).contains(state.theta_hat) and state.pivot > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["xarm7", "z1", "panda", "kinova"])
@pytest.mark.parametrize("law", ["memory", "cone"])
@pytest.mark.parametrize("error", [1.0, 2.0, 3.0])
def test_no_start_of_another_arm_is_lost(name, law, error):
    for seed in (3, 301, 302):
        _, following = followed(name, law, error, seed, 5.0)
        assert following.ended is None and following.drift < 1e-4


def test_steps_are_divided_only_where_they_are_too_long(monkeypatch):
    divided = []
    own = NullspaceIdentifier._halved

    def spied(self, log):
        divided.append(len(log.t))
        return own(self, log)

    monkeypatch.setattr(NullspaceIdentifier, "_halved", spied)
    _, following = followed("ur5", "memory", 3.0, 213, 0.3)
    assert divided and following.drift <= 150 * ACCURACY
    _, near = followed("ur5", "memory", 0.3, 213, 0.3)
    before = len(divided)
    assert near.ended is None and len(divided) == before  # none from a usual prior


def test_a_controller_with_a_wrong_model_commands_no_more_than_its_limit():
    scenario = replace(load("ur5"), initial_error=3.0, seed=103, duration=1.0)
    setup = Setup.of(scenario)
    with setup.plant.running():
        log = setup.simulate()
    limit = 5.0 * setup.system.scales.command
    assert (np.abs(log.u) <= limit).all() and (np.abs(log.u) == limit).any()
    assert np.abs(log.v).max() < 100
