"""Identifiers run in batches give what each gives alone, for any number of runs and jobs."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from nsaid_mj import (
    ArmPlant,
    BlueROV2Plant,
    FourierTracking,
    MultisineCommand,
    NullspaceAID,
    ScalarRovPlant,
    Scenario,
)
from nsaid_mj.base.errors import BadRun, InvalidInput
from nsaid_mj.cli.commands import command
from nsaid_mj.core.laws.base import Estimates, State, Status
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier, paper_identifier
from nsaid_mj.core.laws.settings import MemoryConfig
from nsaid_mj.core.log import Log
from nsaid_mj.core.numerics.lanes import WIDTH
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab import following
from nsaid_mj.lab import loop as experiment
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.setup import Setup
from nsaid_mj.plans.studies import montecarlo, montecarlo_results
from nsaid_mj.plans.studies.folder import ROWS, TABLE
from nsaid_mj.plans.studies.montecarlo import DrawnMotion, montecarlo_plan
from nsaid_mj.report.terminal import print_page
from tests.support.studies import COSTS, monte_carlo
from tests.support.summaries import summarize

ARM = Scenario(
    ArmPlant("double_pendulum"),
    FourierTracking(0.2),
    NullspaceAID(gain=0.3),
    duration=1.2,
)
BOAT = Scenario(
    BlueROV2Plant(), MultisineCommand(0.1, 1.0), NullspaceAID(6.0, 0.6), duration=6.0, dt=0.01
)
SCENARIOS = {
    "arm": ARM,
    "arm, cone": replace(ARM, identifier=NullspaceAID(gain=0.3, law="cone")),
    "arm, Pinocchio": replace(
        ARM, plant=ArmPlant("double_pendulum", backend="pinocchio"), duration=0.2
    ),
    "arm, noise": replace(ARM, sensors="noisy"),
    "arm, memory": replace(
        ARM, identifier=NullspaceAID(law="memory", memory=MemoryConfig(interval=0.1)), duration=0.6
    ),
    "boat": BOAT,
    "number": Scenario(ScalarRovPlant(), MultisineCommand(), duration=3.0, dt=0.01),
}
every = pytest.mark.parametrize("name", SCENARIOS)
FEW = 5


def figures(rows: list[dict]) -> list[dict]:
    """Rows without what they cost."""
    return [{key: value for key, value in row.items() if key not in COSTS} for row in rows]


def course_of(scenario: Scenario) -> DrawnMotion:
    (course,) = montecarlo.simulate([scenario], montecarlo.ThreadPoolExecutor(1))
    return course


def stepped(course: DrawnMotion, scenario: Scenario) -> State:
    """The last state of a draw, one `step` after the other."""
    law = course.setup.with_prior_of(scenario).identifiers()[""]
    state = law.init(course.log.at(0))
    for previous, now in pairwise(course.log.rows):
        state = law.step(state, previous, now)
    return state


@every
def test_runs_do_not_depend_on_their_number_or_on_jobs(name):
    rows = figures(monte_carlo(SCENARIOS[name], FEW, jobs=1))
    assert figures(monte_carlo(SCENARIOS[name], 9, jobs=2))[:FEW] == rows
    assert len({row["theta_perp_ratio"] for row in rows}) == FEW  # draws differ
    assert [row["run"] for row in rows] == list(range(FEW))


@every
def test_a_run_equals_stepping_the_identifier(name):
    scenario = SCENARIOS[name]
    rows, course = monte_carlo(scenario, 2, jobs=2), course_of(scenario)
    for row in rows:
        state = stepped(course, replace(scenario, seed=row["seed"]))
        assert state.status.words == row["status"]
        assert row["theta_perp_ratio"] == float(course.ratio(state.theta_hat))


@pytest.mark.parametrize("name", ["arm", "arm, noise", "boat"])
def test_unshared_plants_give_the_runs_of_their_seeds(name, tmp_path):
    scenario = SCENARIOS[name]
    rows = monte_carlo(scenario, 3, jobs=2, shared=False)
    assert len({row["theta_perp_ratio_initial"] for row in rows}) == 3
    alone = experiment.run(replace(scenario, seed=rows[2]["seed"]), tmp_path)
    course = course_of(alone.scenario)
    assert np.array_equal(course.truth.theta, alone.plant.truth)
    for key, part in zip("tqvu", course.log, strict=True):
        assert np.array_equal(part, alone.record[key])
    last = alone.record["theta_hat"][-1]
    assert rows[2]["theta_perp_ratio"] == float(course.ratio(last))
    summary = summarize(alone, Truth.of(alone))
    for key in ("status", "status_time", "actuator_ratio_error"):
        assert rows[2][key] == summary[key], key
    for key in ("theta_perp_ratio", "theta_perp_ratio_initial"):
        assert rows[2][key] == pytest.approx(summary[key], rel=1e-12), key


def test_other_plants_have_other_truths():
    with montecarlo.ThreadPoolExecutor(2) as pool:
        one, other = montecarlo.simulate([replace(BOAT, seed=k) for k in (1, 2)], pool)
    assert not np.array_equal(one.truth.theta, other.truth.theta)
    assert not np.array_equal(one.log.v, other.log.v)


def test_a_diverging_identifier_does_not_affect_the_others(monkeypatch):
    """One of the group adapts far too fast."""
    want, honest = figures(monte_carlo(ARM, FEW, jobs=1)), Setup.identifiers
    seed = want[2]["seed"]

    def mixed(setup):
        gain = 1e6 if setup.scenario.seed == seed else 0.3
        hot = replace(setup.scenario.identifier, gain=gain)
        return honest(replace(setup, scenario=replace(setup.scenario, identifier=hot)))

    monkeypatch.setattr(Setup, "identifiers", mixed)
    monkeypatch.setattr(montecarlo, "_GROUP", FEW)
    found = figures(monte_carlo(ARM, FEW, jobs=1))
    assert found[2]["status"] != Status.completed.words and found[2]["status_time"] < ARM.duration
    assert found[2]["time_to_converge"] is None
    assert found[:2] + found[3:] == want[:2] + want[3:]


@pytest.mark.parametrize(
    "gain,drift,status",
    [
        (1e6, 1e-3, Status.estimate_not_positive_definite),
        (1e3, 0.0, Status.adaptation_too_fast),
    ],
)
def test_a_failed_run_ends_as_it_does_alone(gain, drift, status, monkeypatch, tmp_path):
    monkeypatch.setattr(following, "DRIFT", drift)
    scenario = replace(ARM, identifier=NullspaceAID(gain=gain))
    rows = monte_carlo(scenario, 2, shared=False)
    for k, row in enumerate(rows):
        alone = experiment.run(replace(scenario, seed=row["seed"]), tmp_path / str(k))
        assert (row["status"], row["status_time"]) == (alone.ending.status.words, alone.ending.time)
        assert row["status"] == status.words


def test_a_plant_that_diverges_ends_its_runs():
    wild = replace(
        BOAT,
        dt=0.5,
        duration=200.0,
        identifier=NullspaceAID(K=1.0, gain=1e-6),
        excitation=MultisineCommand(0.1, 0.4, amplitude=1e4),
    )
    rows = monte_carlo(wild, 3, jobs=2, shared=False)
    assert {row["status"] for row in rows} <= {s.words for s in Status}
    assert any(row["status"] == Status.plant_diverged.words for row in rows)
    assert all(row["status_time"] < wild.duration for row in rows)


@pytest.mark.parametrize("runs,jobs,name", [(0, 1, "runs"), (-3, 1, "runs"), (1, 0, "jobs")])
def test_zero_runs_or_zero_jobs_is_refused(runs, jobs, name):
    with pytest.raises(InvalidInput) as caught:
        monte_carlo(ARM, runs, jobs)
    assert caught.value.name == name


# -- identifiers that share a motion -------------------------------------------------------------

FULL = 12  # identifiers that share a motion


def laws_of(course: DrawnMotion, count: int) -> list[NullspaceIdentifier]:
    """Identifiers whose priors and gains all differ."""
    laws = []
    for k in range(count):
        scenario = replace(course.setup.scenario, seed=100 + k)
        law = course.setup.with_prior_of(scenario).identifiers()[""]
        assert isinstance(law, NullspaceIdentifier)
        laws.append(with_gains(law, law.K * (1 + 0.01 * k), law.metric.Gamma * (1 + 0.1 * k)))
    return laws


def with_gains(law: NullspaceIdentifier, K: Array, Gamma: Array) -> NullspaceIdentifier:
    """The paper's identifier with other gains."""
    return paper_identifier(law.system, K, Gamma, law.prior, ARM.dt, law.hermite)


def equal(one: tuple[State, Estimates], other: tuple[State, Estimates]) -> bool:
    """Whether every bit is."""
    same = (np.array_equal(a, b, equal_nan=True) for a, b in zip(one[1], other[1], strict=True))
    (a, b), parts = (one[0], other[0]), ("t", "v_hat", "theta_hat", "pivot", "spent")
    return (
        a.status == b.status
        and all(same)
        and all(
            np.array_equal(getattr(a, part), getattr(b, part), equal_nan=True) for part in parts
        )
    )


def followed(laws: list[NullspaceIdentifier], log: Log) -> list[tuple[State, Estimates]]:
    """What the identifiers make of a log whose motion they share."""
    states = [law.init(log.at(0)) for law in laws]
    return list(NullspaceIdentifier.followed_together(laws, states, log, laws[0].motion(log)))


def alone(law: NullspaceIdentifier, log: Log) -> tuple[State, Estimates]:
    return law.follow(law.init(log.at(0)), log)


@pytest.fixture(scope="module")
def arm() -> DrawnMotion:
    return course_of(ARM)


@pytest.mark.parametrize(
    ("robot", "count"), [("double_pendulum", WIDTH + 1), ("z1", FULL), ("ur5", FULL)]
)
def test_identifiers_that_share_a_motion_get_the_bits_of_single_runs(robot, count):
    plant = ArmPlant(robot, armature=0.1, damping=0.5, friction=0.5)
    course = course_of(replace(ARM, plant=plant, duration=0.6))
    laws = laws_of(course, count)
    made = followed(laws, course.log)
    for law, one in zip(laws, made, strict=True):
        assert equal(one, alone(law, course.log))
    assert len({one[0].theta_hat.tobytes() for one in made}) == count


@pytest.mark.parametrize("gains", ["full", "of two shapes"])
def test_identifiers_with_full_gains_get_the_bits_of_single_runs(gains, arm):
    laws = laws_of(arm, WIDTH)
    for k, law in enumerate(laws):
        if gains == "full" or k == 3:
            laws[k] = with_gains(law, np.diag(law.K), np.diag(law.metric.Gamma))
    for law, one in zip(laws, followed(laws, arm.log), strict=True):
        assert equal(one, alone(law, arm.log))


@pytest.mark.parametrize("hot", [[0], [3], [1, 6]])
def test_a_failing_identifier_ends_as_alone_and_the_others_continue(hot, arm):
    laws = laws_of(arm, FULL)
    for k in hot:
        laws[k] = with_gains(laws[k], laws[k].K, 1e7 * laws[k].metric.Gamma)
    for k, (law, one) in enumerate(zip(laws, followed(laws, arm.log), strict=True)):
        assert (one[0].status is Status.completed) == (k not in hot)
        assert equal(one, alone(law, arm.log))


def test_a_nonfinite_measurement_ends_every_identifier_as_alone(arm):
    laws, v = laws_of(arm, FULL), arm.log.v.copy()
    v[40, 0] = np.nan
    log = Log.unchecked(arm.log.t, arm.log.q, v, arm.log.u)
    for law, one in zip(laws, followed(laws, log), strict=True):
        assert one[0].status is Status.measurement_not_finite and len(one[1].pivot) < 42
        assert equal(one, alone(law, log))


def test_an_ended_identifier_stays_as_it_is(arm):
    law = laws_of(arm, 1)[0]
    ended = law.init(arm.log.at(0))._replace(status=Status.adaptation_too_fast)
    stays = law.along(ended, arm.log, law.motion(arm.log))
    assert stays[0] is ended and len(stays[1].pivot) == 1


# -- the command -------------------------------------------------------------------------------


def test_montecarlo_writes_a_table_and_resumes(tmp_path, capsys):
    words = ["montecarlo", "scalar_rov", "--duration=2", "--jobs=2", f"--out={tmp_path / 'mc'}"]
    assert command([*words, "--runs=4", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    table = pq.read_table(tmp_path / "mc" / TABLE)
    far = np.sort(table["theta_perp_ratio"].to_numpy())
    assert printed["quantiles"]["theta_perp_ratio"]["worst"] == far[-1]
    assert far[0] <= printed["quantiles"]["theta_perp_ratio"]["median"] <= far[-1]
    assert printed["runs"] == table.num_rows == 4 and printed["lost"] == []
    rows = (tmp_path / "mc" / ROWS).read_text().splitlines()
    (tmp_path / "mc" / ROWS).write_text("\n".join(rows[:2]) + "\n" + rows[2][:9])
    assert command([*words, "--runs=4"]) == 0
    again = pq.read_table(tmp_path / "mc" / TABLE)
    for key in set(table.column_names) - set(COSTS):
        assert again[key].equals(table[key]), key
    said = capsys.readouterr().out
    assert said.lstrip()[0] in "✔◐✘" and "4 priors on one motion, 0 lost" in said
    with pytest.raises(BadRun, match="runs differ"):
        command([*words, "--runs=5"])


def test_failed_runs_are_listed_with_their_seeds(tmp_path, capsys):
    study = montecarlo_plan("ur5", replace(ARM, identifier=NullspaceAID(gain=1e6)), 3)
    found = montecarlo_results.run_montecarlo(study, tmp_path / "mc", 2, quiet=True)
    print_page(montecarlo_results.montecarlo_page(found), Console(width=200))
    said = capsys.readouterr().out
    assert "3 lost" in said
    for row in found.rows:
        assert f"run {row['run']} (seed {row['seed']})" in said
        assert row["status"] in said
    assert (
        montecarlo_results.montecarlo_document(found)["quantiles"]["theta_perp_ratio"]["median"]
        is None
    )


def test_many_runs_get_a_report_with_plots(tmp_path, capsys):
    """Of runs that ended well, and of none that did."""
    for name, gain in (("well", 0.3), ("lost", 1e6)):
        study = montecarlo_plan(
            "double_pendulum", replace(ARM, identifier=NullspaceAID(gain=gain)), 3
        )
        montecarlo_results.run_montecarlo(study, tmp_path / name, 1, quiet=True)
        assert command(["report", str(tmp_path / name)]) == 0
        assert "report.html" in capsys.readouterr().out
        page = (tmp_path / name / "report.html").read_text()
        assert "3 of 3 runs" in " ".join(page.split()) and "3 seeds" in page


def test_montecarlo_refuses_a_folder_of_something_else_and_keeps_it(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(BadRun, match="other files"):
        montecarlo_results.run_montecarlo(montecarlo_plan("ur5", ARM, 2), tmp_path, quiet=True)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
