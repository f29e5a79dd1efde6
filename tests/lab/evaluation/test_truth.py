"""Without a truth, figures that need one are absent and everything else is unchanged."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from nsaid_mj import (
    ArmPlant,
    BlueROV2Plant,
    ConventionalAID,
    FourierTracking,
    Loss,
    MultisineCommand,
    NullspaceAID,
    Scenario,
)
from nsaid_mj.base.files import OutputFolder
from nsaid_mj.core.log import Log
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.evaluation.figures import averaged_rows, residual_ratio
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.evaluation.verify import Verification
from nsaid_mj.lab.loop import Run, SimulatedRun, run
from nsaid_mj.lab.record import RECORD_FILE as RECORD
from nsaid_mj.lab.recording.run import write_run_recording
from nsaid_mj.report.page import Page
from tests.support.faulty import ROV
from tests.support.recordings import entities_of
from tests.support.summaries import evaluated, summarize, unknown

NOISY = replace(
    ROV,
    rivals={"conventional": ConventionalAID(K=10.0, gain=0.3)},
    sensors="noisy",
    duration=4.0,
)
ARM = Scenario(
    ArmPlant("double_pendulum", damping=0.1, backend="compiled"),
    FourierTracking(0.2),
    NullspaceAID(law="memory"),
    duration=2.0,
    pe_window=0.5,
    held_out=0.2,
)
BOAT = Scenario(
    BlueROV2Plant(faults=(Loss(share=0.4, actuator=3, time=2.0),)),
    MultisineCommand(0.1, 1.0),
    NullspaceAID(6.0, 0.6),
    duration=4.0,
    dt=0.01,
    held_out=0.5,
)
SCENARIOS = {"number": NOISY, "arm": ARM, "boat": BOAT}
OF_THE_TRUTH = {
    "theta_perp_ratio",
    "theta_perp_ratio_initial",
    "plant_direction_error",
    "actuator_ratio_error",
    "force_residual_ratio",
    "force_residual_floor",
    "lyapunov_violations",
    "lyapunov_largest_rise",
    "lyapunov_bound",
    "pe_level_perp",
    "pe_share_perp",
    "r_excited",
    "excited_error_rms",
    "excited_error_rms_initial",
    "assumption_46_margin",
    "least_mass_eigenvalue",
    "mismatch",
    "fault",
}


@pytest.fixture(scope="module", params=SCENARIOS)
def done(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    return run(SCENARIOS[request.param], tmp_path_factory.mktemp(request.param))


def leaves(value: Any, key: str = "") -> list[tuple[str, Any]]:
    """Every value that is not a container, with the last key above it."""
    if isinstance(value, dict):
        return [leaf for name, part in value.items() for leaf in leaves(part, name)]
    if isinstance(value, list):
        return [leaf for part in value for leaf in leaves(part, key)]
    return [(key, value)]


def test_without_a_truth_only_the_comparisons_are_missing(done):
    whole, bare = summarize(done, Truth.of(done)), summarize(unknown(done), None)
    assert whole.keys() - bare.keys() == OF_THE_TRUTH
    assert bare.keys() - whole.keys() == {"force_residual_ratio_measured"}
    judged = {"rivals", "parameters", "confidence", "r", "rank_gap", "unobservable", "verdict"}
    for key in (whole.keys() & bare.keys()) - judged:
        assert bare[key] == whole[key], key
    for name, rival in bare["rivals"].items():
        assert rival.keys() - whole["rivals"][name].keys() == {"force_residual_ratio_measured"}
        assert not rival.keys() & OF_THE_TRUTH
    assert all("true" not in row for row in bare["parameters"])
    if whole["confidence"]:
        compared = whole["confidence"].keys() - bare["confidence"].keys()
        assert compared == {"covered", "forces_covered"}


def test_no_summary_value_is_a_placeholder(done):
    for key, value in leaves(summarize(unknown(done), None)):
        assert value is not None or key in {"confidence", "conserved_drift"}, key
        assert not isinstance(value, float) or math.isfinite(value), key
        if key.startswith(("force_", "velocity_error", "least_")):
            assert value and value > 0, key


def test_without_a_truth_the_nullspace_is_that_of_the_estimate(done):
    bare, seeds = summarize(unknown(done), None), done.setup.seeds
    theta = done.record["theta_hat"][-1]
    wanted = Nullspace.structural(done.system, theta, np.random.default_rng(seeds.structure))
    assert (bare["r"], bare["rank_gap"]) == (wanted.r, [float(s) for s in wanted.gap])


def test_the_measured_residual_falls_as_the_estimate_converges(tmp_path):
    long = replace(ROV, duration=40.0)
    done = unknown(run(long, tmp_path))
    late = summarize(done, None)["force_residual_ratio_measured"]
    start = done.record["theta_hat"][0]
    columns = {**done.record.columns, "theta_hat": np.tile(start, (len(done.record), 1))}
    stuck = dataclasses.replace(done, record=dataclasses.replace(done.record, columns=columns))
    assert late < 2e-3 * summarize(stuck, None)["force_residual_ratio_measured"]


def test_a_gap_in_a_measured_log_does_not_enter_its_residual(done):
    """Under the true θ, what is left is noise; across a gap, any acceleration would be missing."""
    system, log = done.system, done.record.log
    kept = np.r_[0 : len(log.t) // 2, len(log.t) // 2 + len(log.t) // 8 : len(log.t)]
    torn = Log.unchecked(*(part[kept] for part in log))
    theta = done.setup.plant.truth
    whole, gapped = (
        residual_ratio(system, averaged_rows(system, one)[1], theta) for one in (log, torn)
    )
    assert gapped == pytest.approx(whole, rel=0.3)


def test_without_recorded_commands_there_is_no_measured_residual(tmp_path):
    done = unknown(run(replace(ROV, record_every=2), tmp_path))
    assert "force_residual_ratio_measured" not in summarize(done, None)
    result = postprocessing.finish(done)
    assert (tmp_path / OutputFolder.RECORDING).is_file()
    assert result.accuracy.velocity_error_rms is not None


def test_a_run_without_rows_has_null_figures(tmp_path):
    done = run(ROV, tmp_path)
    none = {name: rows[:0] for name, rows in done.record.columns.items()}
    done.record = replace(done.record, columns=none)
    whole, bare = summarize(done, Truth.of(done)), summarize(unknown(done), None)
    assert bare["velocity_error_rms"] is None and bare["pe_level"] is None
    assert not bare.keys() & OF_THE_TRUTH
    assert whole["theta_perp_ratio"] is None and whole["pe_level_perp"] is None


def test_a_run_without_a_truth_is_recorded_and_reported(done, tmp_path):
    shutil.copy(done.folder / RECORD, tmp_path)  # results are written beside their own record only
    bare = dataclasses.replace(unknown(done), folder=tmp_path)
    summary = postprocessing.finish(bare).summary()
    assert json.loads((tmp_path / postprocessing.SUMMARY).read_text(encoding="utf-8")) == summary
    page = (tmp_path / Page.FILE).read_text(encoding="utf-8")
    assert "nan" not in page and "distance to the true set" not in page
    seen = entities_of(tmp_path / OutputFolder.RECORDING)
    wanted = {"/velocity/measured", "/velocity/predicted", "/force/motion", "/force/actuators"}
    if len(bare.system.space.actuators) > 1:
        wanted.add("/gains_over_prior")
    assert wanted <= seen.keys()
    absent = ("/distance", "/share", "/lyapunov", "/theta_perp", "/robot/body/force/commanded")
    assert not [path for path in seen if path.startswith(absent) or "true_direction" in path]


def test_a_recording_without_a_truth_shows_the_robot_move(tmp_path):
    done = run(BOAT, tmp_path)
    bare = Run(**{field.name: getattr(done, field.name) for field in fields(Run)})
    write_run_recording(bare, evaluated(bare, None), None)
    seen = entities_of(tmp_path / OutputFolder.RECORDING)
    assert "/robot/body" in seen and "/robot/body/force/estimated" in seen
    assert "/robot/body/force/commanded" not in seen
    assert any("Mesh3D" in column for columns in seen.values() for column in columns)


def test_without_a_truth_only_the_conserved_quantity_is_verified(done):
    said = {v.statement: v.verdict for v in Verification.of_run(unknown(done), None).statements}
    own = said.pop("(30) in (45)")
    assert set(said.values()) == {"not applicable"} and own == "holds"


def test_a_fault_changes_the_truth_at_its_time(tmp_path):
    done = run(BOAT, tmp_path)
    truth = Truth.of(done)
    assert truth is not None
    before, after = truth.theta_at(np.array([0.0, 4.0]))
    assert (before == truth.initial).all() and (after == truth.theta).all()
    assert (before != after).sum() == 1
    far = truth.distance(np.array([0.0, 4.0]), np.array([before, before]))
    assert far[0] < 1e-9 < far[1]


@pytest.mark.parametrize(
    ("distances", "expected"),
    [
        ([0.5, 0.01, 0.001], 1.0),
        ([0.5, 0.001, 0.02, 0.005], 3.0),  # it did not stay
        ([0.001, 0.001], 0.0),
        ([0.5, 0.001, 0.011], None),
        ([0.001, math.nan, 0.001], 2.0),
        ([0.001, math.nan], None),
    ],
)
def test_converged_at_is_when_the_estimate_stays_near_the_true_set(distances, expected):
    t = np.arange(len(distances), dtype=float)
    truth: Any = SimpleNamespace(distance=lambda t, theta_hat: theta_hat[:, 0])
    assert Truth.converged_at(truth, t, np.array(distances)[:, None]) == expected
