"""summary.json is a view of a run's result: what is read back is what was written."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from nsaid_mj.lab.evaluation.run_evaluation import evaluate
from nsaid_mj.lab.evaluation.run_result import RunResult
from nsaid_mj.lab.evaluation.statistics import Accuracy
from nsaid_mj.lab.evaluation.summary import result_from
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.loop import SimulatedRun, run
from tests.support.faulty import WITH_RIVAL
from tests.support.summaries import run_result, unknown


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    return run(replace(WITH_RIVAL, sensors="noisy"), tmp_path_factory.mktemp("run"))


def read_back(result: RunResult) -> RunResult:
    return result_from(json.loads(json.dumps(result.summary(), allow_nan=False)))


def assert_the_same(result: RunResult) -> None:
    written, again = result.summary(), read_back(result)
    assert json.dumps(again.summary()) == json.dumps(written)  # keys and values, in their order
    assert (again.explains, again.verdict) == (result.explains, result.verdict)
    assert again.statistics == result.statistics and again.findings == result.findings


def test_a_result_is_read_back_from_its_summary(done: SimulatedRun) -> None:
    assert_the_same(evaluate(done, Truth.of(done)))


def test_a_result_without_a_truth_is_read_back_from_its_summary(done: SimulatedRun) -> None:
    assert_the_same(evaluate(unknown(done), None))


def test_a_result_without_rows_is_read_back_from_its_summary(done: SimulatedRun) -> None:
    none = {name: rows[:0] for name, rows in done.record.columns.items()}
    empty = replace(done, record=replace(done.record, columns=none))
    for result in (evaluate(empty, Truth.of(empty)), evaluate(unknown(empty), None)):
        assert not result.recorded and "parameters" not in result.summary()
        assert_the_same(result)


def test_what_needs_an_unknown_truth_is_absent_and_what_is_undefined_is_null() -> None:
    nothing = Accuracy(force_residual_ratio_measured=float("nan"))
    blind = run_result(truth_known=False, accuracy=nothing).summary()
    assert blind["force_residual_ratio_measured"] is None and blind["conserved_drift"] is None
    assert not {"theta_perp_ratio", "lyapunov_violations", "mismatch", "fault"} & blind.keys()
    known = run_result().summary()
    assert known["theta_perp_ratio"] is None and known["lyapunov_violations"] is None
    assert "force_residual_ratio_measured" not in known
