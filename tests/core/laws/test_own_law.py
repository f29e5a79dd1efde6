"""A user's own law and supervisor run without an edit of the package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.conventional import ConventionalAID
from nsaid_mj.core.laws.efficient.law import EfficientIdentifier
from nsaid_mj.core.laws.efficient.state import EfficientState
from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.log import Log
from nsaid_mj.lab.evaluation.run_evaluation import evaluate
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.evaluation.verify import Verification
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.plants.world.faults.text import parse_faults
from nsaid_mj.lab.postprocessing import finish
from nsaid_mj.lab.setup import Setup
from tests.support.bench import bench
from tests.support.own_law import OwnConfig, OwnLaw

# -- a law of rates --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum", "ur5"])
def test_a_law_of_the_papers_rates_is_the_compiled_one(name: str) -> None:
    table = bench(name)
    system, prior, seen = table.system, table.prior(0.1), table.drive(30 * table.dt)
    log = Log(*map(np.array, zip(*seen, strict=True)))
    K, Gamma = 5.0 * np.eye(system.n), 0.1 * np.diag(system.space.scale**2)
    laws = OwnLaw(system, K, Gamma, prior), paper_identifier(system, K, Gamma, prior, table.dt)
    (_, own), (_, compiled) = (law.follow(law.init(log.at(0)), log) for law in laws)
    np.testing.assert_allclose(own.v_hat, compiled.v_hat, rtol=1e-10, atol=1e-12)
    scale = system.space.scale
    np.testing.assert_allclose(own.theta_hat / scale, compiled.theta_hat / scale, atol=1e-11)


def test_a_law_that_loses_the_mass_matrix_ends_with_that_status() -> None:
    table = bench("scalar_rov")
    system, log = table.system, Log(*map(np.array, zip(*table.drive(1.0), strict=True)))
    Gamma = 1e9 * np.diag(system.space.scale**2)
    law = OwnLaw(system, 5.0 * np.eye(1), Gamma, table.prior(0.3))
    state, estimates = law.follow(law.init(log.at(0)), log)
    assert state.status is not Status.completed
    assert 1 <= len(estimates.pivot) < len(log.t)
    assert law.follow(state, log)[0] is state


def test_rates_of_another_shape_are_refused() -> None:
    table = bench("scalar_rov")

    class Wrong(OwnLaw):
        def rates(self, *_: object) -> tuple[np.ndarray, np.ndarray]:
            return np.zeros(2), np.zeros(4)

    law = Wrong(table.system, np.eye(1), np.eye(4), table.truth)
    log = Log(*map(np.array, zip(*table.drive(0.1), strict=True)))
    with pytest.raises(InvalidInput, match="rates"):
        law.follow(law.init(log.at(0)), log)


def test_a_run_of_an_own_law_is_summarised_verified_and_shown_by_its_name(tmp_path: Path) -> None:
    scenario = load("scalar_rov")
    rivals = {"compiled": NullspaceAID(K=10.0, gain=2.0)}
    scenario = replace(
        scenario, identifier=OwnConfig(10.0, 2.0), rivals=rivals, duration=3.0, held_out=1.0
    )
    done = run(scenario, tmp_path)
    truth = Truth.of(done)
    result = evaluate(done, truth)
    summary = result.summary()
    assert summary["law"] == "own words" and summary["gamma"] == "own"
    assert summary["status"] == "completed" and "misfit" not in summary
    own, rival = summary["theta_perp_ratio"], summary["rivals"]["compiled"]["theta_perp_ratio"]
    assert own == pytest.approx(rival, rel=1e-6)
    words = {
        verdict.statement: verdict.verdict
        for verdict in Verification.of_run(done, truth, result).statements
    }
    assert words["Theorem 1 (69)"] == words["(30) in (45)"] == "not applicable"
    assert words["Theorem 1 (70)"] != "not applicable"
    finish(done)
    assert "own words" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_the_packages_laws_keep_their_names() -> None:
    laws = ("paper", "cone", "memory", "efficient")
    assert tuple(NullspaceAID(law=law).name for law in laws) == laws
    assert NullspaceAID(law="cone", barrier=0.0).name == ConventionalAID().name == "paper"


# -- a supervisor ----------------------------------------------------------------------------------


class Counting:
    """A supervisor that counts its calls, and restarts the filter where it is contradicted."""

    def __init__(self, law: EfficientIdentifier):
        self.law, self.contradictions, self.samples = law, 0, 0

    def contradicted(self, state: EfficientState, log: Log) -> EfficientState:
        self.contradictions += 1
        here = state.here(self.law.system, log)
        return state.restarted(self.law.estimator, here)

    def tried(self, state: EfficientState, log: Log) -> tuple[EfficientState, int]:
        raise AssertionError("it tries nothing")

    def watched(self, state: EfficientState, log: Log) -> EfficientState:
        self.samples += len(log.t) - 1
        assert state.step == self.samples
        return state


def test_a_law_without_a_supervisor_restarts_and_one_of_ones_own_is_called_in_its_places() -> None:
    scenario = load("bluerov2")
    law = replace(scenario.identifier, law="efficient", gamma="scale")
    plant = replace(scenario.plant, faults=parse_faults("loss 0.4 of 3 at 3 s"))
    common = {"rivals": {}, "sensors": "noisy", "duration": 5.0, "seed": 31}
    setup = Setup.of(replace(scenario, plant=plant, identifier=law, **common))
    watched = setup.identifiers()[""]
    assert isinstance(watched, EfficientIdentifier) and watched.supervisor is not None
    with setup.plant.running():
        log = setup.simulate()
    alone = EfficientIdentifier(watched.guard, watched.estimator)
    state, estimates = alone.follow(alone.init(log.at(0)), log)
    assert state.own.restarts > 0 and state.faults == ()
    counting = Counting(alone)
    guest = alone.supervised_by(counting)
    other, same = guest.follow(guest.init(log.at(0)), log)
    assert counting.samples == len(log.t) - 1
    assert counting.contradictions == other.own.restarts == state.own.restarts
    np.testing.assert_array_equal(same.theta_hat, estimates.theta_hat)
