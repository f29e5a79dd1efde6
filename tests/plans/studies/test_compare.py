"""`nsaid compare`: one log, one prior and the same figures for all methods; failures reported."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from rich.console import Console

from nsaid_mj.base.choices import CHOICES
from nsaid_mj.base.errors import BadRun, InvalidInput, NoEstimate, UnknownName
from nsaid_mj.cli.commands import command
from nsaid_mj.core.laws.conventional import ConventionalAID
from nsaid_mj.lab.library import load
from nsaid_mj.plans.baselines import BATCH
from nsaid_mj.plans.baselines.base import MethodEstimate
from nsaid_mj.plans.studies import compare, compare_report
from nsaid_mj.plans.studies.compare import BOUND, PRIOR, ComparedPlant
from nsaid_mj.plans.studies.compare_report import (
    figures,
    groups_of,
    over_bound,
    row_of,
    runs_of,
)
from nsaid_mj.plans.studies.runs import Runs
from nsaid_mj.plans.studies.study import Row, Study
from nsaid_mj.report.page import render_html
from nsaid_mj.report.terminal import print_page
from tests.report.pages.markup import Page, data_of

SCALAR = load("scalar_rov")
MANIFEST = {
    "script": "ur5",
    "methods": ["ols", "memory", "tls"],
    "seeds": [0, 1],
    "durations": [2.0],
    "noises": [1.0],
    "bound": False,
    "versions": {"numpy": "2"},
    "arguments": ["--dt", "0.01"],
}


def plan(**changes) -> Study:
    given = {"methods": ("paper", "ols"), "seeds": (0,), "durations": (2.0, 4.0)}
    return compare.comparison_plan("scalar_rov", SCALAR, **(given | changes))


def cells(**changes) -> list[Row]:
    return list(compare.compare(plan(**changes)))


def runs(rows: list[Row]) -> Runs:
    return runs_of(Path("a"), MANIFEST, rows)


# -- the plan --------------------------------------------------------------------------------


def test_an_unknown_method_is_refused_with_near_names():
    with pytest.raises(UnknownName) as caught:
        plan(methods=("wsl",))
    assert "wls" in caught.value.near
    assert set(BATCH) | {"paper", "cone", "conventional", "sysid"} <= set(caught.value.choices)


@pytest.mark.parametrize(
    "changes",
    [
        {"methods": ()},
        {"methods": ("ols", "ols")},
        {"seeds": ()},
        {"seeds": (-1,)},
        {"durations": (0.0,)},
        {"durations": (np.inf,)},
        {"noises": (-1.0,)},
        {"noises": (np.nan,)},
        {"budget": 0.0},
    ],
)
def test_a_plan_that_cannot_be_run_is_refused(changes):
    with pytest.raises(InvalidInput):
        plan(**changes)


def test_a_scenario_of_another_identifier_is_refused():
    with pytest.raises(InvalidInput, match="NullspaceAID"):
        compare.comparison_plan("scalar_rov", replace(SCALAR, identifier=ConventionalAID()))


def test_every_law_can_be_compared():
    """A law that is added to NullspaceAID is a method without a line here."""
    laws = CHOICES["law of a run"]
    assert {"paper", "cone"} <= set(laws)
    found = cells(methods=laws, durations=(1.0,))
    assert [cell["method"] for cell in found] == [PRIOR, *laws]
    assert not any(cell["failure"] for cell in found)


# -- the cells -------------------------------------------------------------------------------


def test_every_combination_has_a_cell_and_the_prior_stays_constant():
    found = cells(seeds=(0, 3), noises=(0.0, 1.0))
    keys = {(c["method"], c["seed"], c["noise"], c["duration"]) for c in found}
    assert len(found) == len(keys) == 3 * 2 * 2 * 2
    for seed in (0, 3):
        priors = {
            c["theta_perp_ratio"] for c in found if c["method"] == PRIOR and c["seed"] == seed
        }
        assert len(priors) == 1  # one prior for all lengths and all noises
    assert len({c["theta_perp_ratio"] for c in found if c["method"] == PRIOR}) == 2


def test_the_same_plan_gives_the_same_figures():
    first, second = cells(noises=(1.0,)), cells(noises=(1.0,))
    assert [c | {"wall_s": None} for c in first] == [c | {"wall_s": None} for c in second]


def test_a_longer_comparison_has_the_same_short_cells():
    """Every method gets the first seconds of one log."""
    short, long = cells(durations=(2.0,)), cells(durations=(2.0, 4.0))
    assert [c["theta_perp_ratio"] for c in short] == [
        c["theta_perp_ratio"] for c in long if c["duration"] == 2.0
    ]


def test_the_bound_grows_with_the_noise_and_no_method_is_far_below_it():
    found = cells(
        methods=("efficient",), seeds=(0, 1, 2), noises=(0.5, 1.0), durations=(4.0,), bound=True
    )
    assert [c["method"] for c in found[:3]] == [PRIOR, BOUND, "efficient"]
    groups = groups_of(runs(found))
    quiet, loud = groups[:3], groups[3:]
    least = [group.median("theta_perp_ratio") for group in (quiet[1], loud[1])]
    assert least[1] / least[0] == pytest.approx(2.0, rel=0.3)
    for _, bound, method in (quiet, loud):
        multiple = over_bound(method, bound, "theta_perp_ratio")
        assert multiple is not None and 0.1 < multiple < 10


def test_the_bound_of_exact_sensors_is_refused():
    with pytest.raises(InvalidInput, match="noisy"):
        plan(noises=(0.0,), bound=True)


def test_noise_is_a_multiple_of_the_scenarios_and_stated_so():
    exact, half, double = (ComparedPlant(plan(noises=(x,)), 0, x)._problem for x in (0.0, 0.5, 2.0))
    assert exact.noise.exact
    assert half.noise.velocity == 0.5 * SCALAR.noise.velocity
    assert double.noise.position == 2.0 * SCALAR.noise.position
    rough = [np.std(np.diff(p.log.v[:, 0], n=3)) for p in (half, double)]
    assert rough[1] / rough[0] == pytest.approx(4.0, rel=0.2)


def test_a_failing_method_says_why_and_the_others_continue(monkeypatch):
    def lost(_):
        raise NoEstimate("it got lost", "Look again.")

    def singular(_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setitem(BATCH, "ols", lost)
    monkeypatch.setitem(BATCH, "wls", singular)
    monkeypatch.setitem(BATCH, "tls", lambda p: MethodEstimate(np.full_like(p.prior, np.nan)))
    found = {c["method"]: c for c in cells(methods=("ols", "wls", "tls", "rls"), durations=(2.0,))}
    assert found["ols"]["failure"] == "it got lost. Look again."
    assert "Singular matrix" in found["wls"]["failure"]
    assert "not finite" in found["tls"]["failure"]
    assert found["ols"]["theta_perp_ratio"] is None
    assert not found["rls"]["failure"] and found["rls"]["theta_perp_ratio"] is not None


def test_a_programming_error_is_not_counted_as_a_methods_failure(monkeypatch):
    def broken(_):
        raise TypeError("a mistake")

    monkeypatch.setitem(BATCH, "ols", broken)
    with pytest.raises(TypeError, match="a mistake"):
        cells()


def test_a_plant_that_diverges_fails_all_methods(monkeypatch):
    def diverge(*_):
        raise NoEstimate("the plant diverged (qacc)", "Use a smaller dt.")

    monkeypatch.setattr(ComparedPlant, "__init__", diverge)
    found = cells()
    assert len(found) == 6
    assert all("diverged" in cell["failure"] for cell in found)


def test_a_method_for_arms_only_says_so_on_a_vehicle():
    (_, cell) = cells(methods=("sysid",), durations=(2.0,))
    assert "arms" in cell["failure"]


def test_a_fault_changes_the_truth_that_judges():
    from nsaid_mj import Loss

    rover = load("bluerov2")
    struck = replace(rover.plant, faults=(Loss(actuator=1, share=0.4, time=2.0),))
    here = compare.comparison_plan(
        "bluerov2", replace(rover, plant=struck), methods=("ols",), seeds=(0,), durations=(1.5, 3.0)
    )
    before, after = (c for c in compare.compare(here) if c["method"] == PRIOR)
    assert before["actuator_ratio_error"] != after["actuator_ratio_error"]


# -- what is reported ----------------------------------------------------------------------------


def test_a_failed_seed_counts_as_infinite():
    made = [row_of("ols", seed, 0.0, 1.0, 0.1 * seed, 0.1, None, 1.0) for seed in (1, 2)]
    made.append(row_of("ols", 3, 0.0, 1.0, failure="it got lost"))
    (group,) = groups_of(runs(made))
    assert group.median("theta_perp_ratio") == 0.2
    assert group.best("theta_perp_ratio") == 0.1
    assert group.worst("theta_perp_ratio") == np.inf
    assert group.median("force_residual_ratio") == np.inf
    assert group.failures == ["it got lost"]


def test_the_table_fits_a_terminal_and_lists_failures():
    made = [
        row_of(m, seed, noise, 20.0, 1.234e-3, 2.345e-3, 3.456e-3, 12.3, "cut-off 4 Hz")
        for m in CHOICES["method"]
        for seed in (0, 1)
        for noise in (0.0, 0.3)
    ]
    made.append(row_of("ekf", 2, 0.0, 20.0, failure="M̂ not positive definite [at] t = 1 s"))
    stream = io.StringIO()
    page = compare_report.page_of(runs(made))
    print_page(page, Console(file=stream, width=80, highlight=False))
    failures, table = stream.getvalue().split(" methods, 3 seeds")
    assert "0.0012 (–)" in table and "…" not in table
    assert "[at] t = 1 s" in failures
    for method in CHOICES["method"]:
        assert method in table


def test_plots_are_drawn_only_where_there_are_enough_cells():
    def made(durations, noises):
        return [
            row_of(m, s, x, d, 1e-3 * d, 1e-2 + x, None, 1.0 + d)
            for m in (PRIOR, "ols", "memory")
            for s in (0, 1)
            for d in durations
            for x in noises
        ]

    every = figures(runs(made((1.0, 2.0), (0.0, 1.0))))
    over = [figure.title.split(" over ")[1].split(":")[0] for figure in every]
    assert over[:5] == [*["wall time"] * 2, *["length of the log"] * 2, "sensor noise"]
    assert len(every) == 2 * 5  # nobody has a force residual
    assert all("over wall time" in f.title for f in figures(runs(made((1.0,), (0.0,)))))
    assert not figures(runs([]))


def test_bars_reach_from_the_best_to_the_worst_seed_and_marks_are_at_the_median():
    cells = [row_of("ols", s, 1.0, 2.0, 1e-3 * 10**s, 1e-2, 1e-3, 1.0 + s) for s in range(3)]
    drawing = ElementTree.fromstring(figures(runs(cells))[0].drawing)
    (axes,) = data_of(figures(runs(cells))[0].drawing)
    assert axes["curves"] == [{"name": "ols", "x": 0, "y": [0.01]}]
    low, high = np.log10(axes["y"]["ends"])
    _, top, _, bottom = axes["box"]
    place = {x: bottom - (x - low) / (high - low) * (bottom - top) for x in (-3, -2, -1)}
    own = [p for p in drawing.iter("path") if p.get("data-curve") == "ols"]
    (bar,) = (p for p in own if "L" in str(p.get("d")))
    heights = [float(word) for word in str(bar.get("d")).split()[2::3]]
    np.testing.assert_allclose(heights, [place[-3], place[-1]], atol=0.02)
    (mark,) = (u for u in drawing.iter("use") if u.get("data-curve") == "ols")
    assert float(str(mark.get("y"))) == pytest.approx(place[-2], abs=0.02)


def test_the_page_has_the_verdict_the_plots_and_every_row(tmp_path):
    cells = [
        row_of(m, s, 1.0, 2.0, x * 1e-3 * (1 + s), 1e-2, 1e-3, 1.0)
        for m, x in ((PRIOR, 300), ("ols", 5), ("memory", 2))
        for s in (0, 1)
    ]
    cells.append(row_of("tls", 0, 1.0, 2.0, failure="<b>it failed"))
    text = render_html(compare_report.page_of(runs(cells)))
    page = Page.of(text)
    assert (
        "memory comes closest to the true set: within 0.003 in the median, 0.004 at worst" in text
    )
    assert [row[0] for row in page.tables[0].rows if len(row) > 1] == [
        PRIOR,
        "memory",
        "ols",
        "tls",
    ]
    assert "<b>it" not in text and "&lt;b&gt;it failed" in text
    assert text.count('role="img"') == 3  # one panel for each figure, over wall time
    assert "nsaid compare ur5 --dt 0.01 --methods ols,memory,tls --seeds 0,1" in text
    empty = render_html(compare_report.page_of(runs([])))
    assert "No method has a result" in empty


# -- the command -----------------------------------------------------------------------------


def test_the_command_writes_all_and_prints_the_table(tmp_path, capsys):
    code = command(
        [
            "compare",
            "scalar_rov",
            "--methods",
            "paper,ols",
            "--seeds",
            "0:2",
            "--durations",
            "2,4",
            "--sensors",
            "ideal,noisy",
            "--noise-scales",
            "0.5,2",
            "--out",
            str(tmp_path / "out"),
            "--initial-error",
            "0.2",
        ]
    )
    assert code == 0
    printed = capsys.readouterr().out
    assert printed.lstrip().startswith("✔ ") and "closest to the true set" in printed  # first
    assert "exact sensors, 4 s" in printed and "2 × noise, 2 s" in printed
    found = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert found["noises"] == [0.0, 0.5, 2.0] and found["seeds"] == [0, 1]
    assert json.loads(found["scenario"])["initial_error"] == 0.2
    assert len(found["cells"]) == 3 * 2 * 2 * 3
    with (tmp_path / "out" / "compare.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert [float(line["theta_perp_ratio"]) for line in lines] == [
        cell["theta_perp_ratio"] for cell in found["cells"]
    ]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {".nsaid-mj.json", "compare.json", "compare.csv", "report.html"}


def test_as_json_it_prints_nothing_else(tmp_path, capsys):
    command(
        [
            "compare",
            "scalar_rov",
            "--methods",
            "ols",
            "--seeds",
            "1",
            "--durations",
            "2",
            "--out",
            str(tmp_path),
            "--json",
        ]
    )
    assert json.loads(capsys.readouterr().out)["methods"] == ["ols"]


@pytest.mark.parametrize(
    "flags, message",
    [
        (["--seeds", "a"], "0:10"),
        (["--seeds", "3:1"], "one or more"),
        (["--durations", "ten"], "comma-separated numbers"),
        (["--noise-scales", "1,x"], "comma-separated numbers"),
        (["--sensors", "loud"], "kind of sensors"),
        (["--methods", "magic"], "unknown method"),
        (["--seed", "3"], "--seeds"),
        (["--duration=3"], "--durations"),
    ],
)
def test_bad_flags_say_what_would_be_accepted(flags, message):
    with pytest.raises((InvalidInput, UnknownName), match=message):
        command(["compare", "scalar_rov", *flags])


def test_an_unwritable_folder_is_refused_before_any_work(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(ComparedPlant, "__init__", lambda *_: pytest.fail("it has begun"))
    with pytest.raises(BadRun, match="--out"):
        compare.run_comparison(plan(), tmp_path / "file" / "out", quiet=True)


def test_stopped_by_ctrl_c_it_writes_what_it_has(tmp_path, monkeypatch):
    def stopped(_):
        raise KeyboardInterrupt

    monkeypatch.setitem(BATCH, "ols", stopped)
    monkeypatch.setattr(ComparedPlant, "warm_up", lambda _: None)
    with pytest.raises(KeyboardInterrupt):
        compare.run_comparison(plan(), tmp_path, quiet=True)
    found = json.loads((tmp_path / "compare.json").read_text())
    assert [cell["method"] for cell in found["cells"]] == [PRIOR, "paper"]
