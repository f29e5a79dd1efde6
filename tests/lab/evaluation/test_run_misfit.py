"""Which runs are judged by their innovations."""

from dataclasses import replace

from nsaid_mj.lab.evaluation.run_misfit import filter_of
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup


def test_on_the_ground_only_noisy_sensors_tell_a_misfit():
    """Ideal ones see more of a touch-down than a step of the integrator resolves."""
    scenario = load("quadruped")
    law = replace(scenario.identifier, law="memory")
    setup = Setup.of(replace(scenario, identifier=law))
    noisy = replace(setup.scenario, sensors="noisy")
    assert filter_of(setup.scenario, setup.system) is None
    assert filter_of(noisy, setup.system) is not None
