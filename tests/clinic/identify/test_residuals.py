"""Structures that are not the robot's: the interval holds, or the verdict is not "yes"."""

import weakref
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from scipy.ndimage import uniform_filter1d

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify.choose.columns import BASIC, BROAD, SPEEDS, Choice
from nsaid_mj.clinic.identify.choose.cutoff import filter_for
from nsaid_mj.clinic.identify.choose.joint_search import (
    choose,
    with_constants,
    with_exact_delays,
)
from nsaid_mj.clinic.identify.fit import minimise, precision
from nsaid_mj.clinic.identify.identifiability import with_known
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.joints import JointRows
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.problem import FitProblem
from nsaid_mj.clinic.identify.residuals import (
    Followed,
    Suspect,
    _closer_to_zero,
    doubts,
    followed,
    widened,
)
from nsaid_mj.clinic.identify.result import JointStructure
from nsaid_mj.clinic.identify.unmodelled_effects import _answered, command_suspects
from nsaid_mj.clinic.identify.verdict import verdict
from nsaid_mj.clinic.logs.recordings import LogSegment, Recordings
from nsaid_mj.core.log import Log
from tests.clinic.identify.test_fit import TRUE, problem_of
from tests.court.field_findings import healthy
from tests.support.robot_logs import Flaw, arm_log, motion, two_joints, write_csv

# -- the test of residuals, on rows whose flaw is known -------------------------------------------


def bent(size: float, seed: int = 0, rows: int = 2000) -> tuple[FitProblem, Suspect, Suspect]:
    """Rows to which a column is added that goes with the first one; it, and one that is noise."""
    problem = with_known(problem_of(0.2, rows, seed), {"gain_1": 1.3, "gain_2": 0.8})
    rng = np.random.default_rng([seed, 5])
    flaw, idle = np.zeros((2, rows, 2, 1))
    flaw[:, 0, 0] = 0.7 * problem.Y[:, 0, 0] + 0.7 * rng.standard_normal(rows)
    idle[:, 0, 0] = rng.standard_normal(rows)
    Y = problem.Y.copy()
    Y[:, 0, 5] -= size * flaw[:, 0, 0] / TRUE[5]
    words = ("its temperature", "the moon")
    true, other = (Suspect(w, "1", c, "Do.") for w, c in zip(words, (flaw, idle), strict=True))
    return replace(problem, Y=Y), true, other


def left_in(problem: FitProblem, *suspects: Suspect):
    """θ̂, its precision, and what the residuals follow."""
    fit, share = minimise(problem), np.ones(2)
    exact = precision(problem, fit, share)
    return fit, exact, followed(problem, fit.theta, exact.covariance, share, list(suspects))


def test_a_suspect_moves_the_estimate_by_its_bias():
    """The step is the difference to the truth, with the sign in which the suspect would move it."""
    problem, true, idle = bent(0.8)
    fit, exact, left = left_in(problem, idle, true)
    assert [each.suspect.words for each in left] == ["its temperature"]
    assert left[0].coefficients[0] == pytest.approx(0.8, rel=0.15)
    off = fit.theta[0] - TRUE[0]
    assert abs(off) > 10 * exact.deviation[0]
    assert left[0].shift[0] == pytest.approx(-off, rel=0.2)
    assert 0.2 < left[0].share[0] < 1 and abs(left[0].share[1]) < 0.01
    assert widened(exact, left).deviation[0] > 0.8 * abs(off)
    np.testing.assert_allclose(widened(exact, left).deviation[1], exact.deviation[1])


def test_chance_is_no_structure():
    found = [len(left_in(*bent(0.0, seed, rows=400))[2]) for seed in range(60)]
    assert sum(found) <= 3


def test_a_single_burst_is_no_structure():
    """One second of a hundred in which all goes with the suspect convicts nobody."""
    problem, true, idle = bent(0.0)
    Y = problem.Y.copy()
    Y[1000:1040, 0, 5] -= 5 * true.columns[1000:1040, 0, 0]
    assert not left_in(replace(problem, Y=Y), true, idle)[2]


@pytest.mark.parametrize("size", [0.0, 0.8])
def test_noise_that_a_suspect_shares_with_the_residuals_is_no_effect(size: float):
    """Of the sensors' noise, which is in both; a true effect is still found beneath it."""
    quiet, true, _ = bent(size)
    rng = np.random.default_rng(7)

    def with_noise(problem: FitProblem, columns: np.ndarray) -> tuple[FitProblem, Suspect]:
        noise, Y, columns = 0.3 * rng.standard_normal(len(problem.t)), problem.Y.copy(), +columns
        Y[:, 0, 0] += noise
        columns[:, 0, 0] += noise
        return replace(problem, Y=Y), true._replace(columns=columns)

    problem, suspect = with_noise(quiet, true.columns)
    fit, exact, blamed = left_in(problem, suspect)

    def noisier(theta: np.ndarray) -> tuple[FitProblem, list[Suspect]]:
        assert (theta == fit.theta).all()
        other, again = with_noise(problem, suspect.columns)
        return other, [again]

    left = followed(problem, fit.theta, exact.covariance, np.ones(2), [suspect], noisier)
    assert blamed and len(left) == (size > 0)


def test_whole_columns_of_many_suspects_are_not_held_together():
    problem, true, _ = bent(0.8)
    held = []

    def suspects() -> Iterator[Suspect]:
        for _ in range(6):
            columns = true.columns.copy()
            held.append(weakref.ref(columns))
            yield true._replace(columns=columns)
            del columns
            assert sum(one() is not None for one in held) <= 1

    fit, exact, _ = left_in(problem)
    assert followed(problem, fit.theta, exact.covariance, np.ones(2), suspects())


def test_a_column_of_the_fit_is_no_suspect():
    problem, *_ = bent(0.0)
    columns = np.zeros((len(problem.t), 2, 2))
    columns[:, 0] = problem.Y[:, 0, [0, 2]]
    assert not left_in(problem, Suspect("itself", "1", columns, ""))[2]


def test_what_matters_is_a_warning_and_ends_a_yes():
    problem, true, idle = bent(0.8)
    _, exact, left = left_in(problem, idle, true)
    (found,) = doubts(problem, exact, left, np.array([0.05, 0.05]))
    assert found.level == "warning" and "its temperature" in found.text and found.remedy == "Do."
    assert "rotor" in str(found.data["parameter"])
    well, badly = ([JointStructure("1", held_out=x)] for x in (0.05, 0.9))
    explains, sentence = verdict(well, [found])
    assert explains == "partly" and "its temperature" in sentence and sentence.endswith("do.")
    assert verdict(badly, [found])[0] == "no" and "do." in verdict(badly, [found])[1]
    note = Finding("note", "residuals", "1", "the residuals follow the moon", "Look up.")
    assert verdict(well, [note]) == verdict(well) and verdict(well)[0] == "yes"


def test_what_explains_a_tenth_of_the_command_matters_even_if_nothing_moves():
    problem, true, _ = bent(0.8)
    _, exact, left = left_in(problem, true)
    still = (left[0]._replace(shift=np.zeros(7)),)
    assert doubts(problem, exact, still, np.array([0.05, 0.05]))[0].level == "note"
    assert doubts(problem, exact, still, np.array([0.4, 0.05]))[0].level == "warning"
    assert not doubts(problem, exact, (still[0]._replace(share=np.full(2, 0.05)),), np.zeros(2))


def test_a_product_of_inertia_that_is_nearly_0_is_measured_against_the_body():
    """Its own size depends on the body's axes."""
    rows = rows_of(arm_log(two_joints(), 0, duration=10.0)[0])
    choice = Choice((BASIC, BASIC), (BROAD, BROAD), np.zeros(2))
    problem = rows.problem(choice)
    exact = precision(problem, minimise(problem), np.ones(2))
    theta, at = exact.theta.copy(), problem.space.labels.index("Ixy of link 2")
    largest = np.abs(theta[problem.space.labels.index("Izz of link 2")])
    theta[at], zero = 1e-3 * largest, np.zeros((1, len(theta)))
    exact = exact._replace(
        theta=theta, covariance=1e-12 * np.diag(theta**2), structure=zero, parts=zero
    )
    for share, level in ((0.05, "note"), (0.5, "warning")):
        shift = np.zeros(len(theta))
        shift[at] = share * largest
        suspect = Suspect("the moon", "", np.zeros((len(rows.t), 2, 1)), "")
        left = (Followed(suspect, np.full(2, 0.5), shift, np.zeros(1)),)
        assert doubts(problem, exact, left, np.zeros(2))[0].level == level


def test_noise_of_either_force_is_not_followed_by_its_own_derivative():
    """A force's noise goes with its second derivative, of whichever side it is; an effect does."""
    rng = np.random.default_rng(0)
    t = 0.05 * np.arange(2000)
    force = np.column_stack([np.sin(2 * t), np.cos(1.3 * t)])
    noises = uniform_filter1d(rng.normal(0, 0.05, (2, 2000, 2)), 5, axis=1)  # low-passed rows

    def bent(force: np.ndarray) -> np.ndarray:
        return np.gradient(np.gradient(force, t, axis=0), t, axis=0)

    def score(needed: np.ndarray, stated: np.ndarray) -> float:
        residual = needed - stated
        own, other = (bent(x)[:, [0]] for x in (stated, needed))
        z = _closer_to_zero(own * residual[:, [0]], other * residual[:, [0]])
        return float(z.sum() / np.linalg.norm(own) / np.linalg.norm(residual[:, 0]))

    assert abs(score(force + noises[0], force)) < 0.05
    assert abs(score(force, force + noises[0])) < 0.05
    assert abs(score(force + noises[0], force + noises[1])) < 0.05
    lagging = force - 0.03 * bent(force)
    assert abs(score(lagging + noises[0], force)) > 0.7
    assert abs(score(lagging, force + noises[0])) > 0.5


def test_noise_of_the_acceleration_is_told_from_a_ratio_by_the_commands():
    """Where noise n of the acceleration is the residual, joint j's column has M n_j of it."""
    rows = rows_of(arm_log(two_joints(), 1, duration=5.0)[0])
    model, rotor = rows.robot.model, np.array([0.3, 0.1])
    data, q = model.createData(), rows.joined(lambda m: m.q)
    upper = np.array([np.triu(pin.crba(model, data, x)) for x in q])
    inertia = upper + np.triu(upper, 1).transpose(0, 2, 1)
    noise = np.random.default_rng(0).standard_normal(q.shape)
    residual = np.einsum("kij,kj->ki", inertia + np.diag(rotor), noise)
    found = _answered(rows, model, rotor, residual)
    np.testing.assert_allclose(found, inertia * noise[:, None, :], rtol=1e-9, atol=1e-12)


def test_a_suspect_is_not_convicted_by_the_residual_in_its_columns():
    """Nearly a column of the fit, beside which the residual is all that is left of it."""
    problem, true, _ = bent(0.8)
    fit, exact, _ = left_in(problem)
    residual = problem.residual(fit.theta)
    nearly = problem.Y[:, :, [0]] + 0.1 * np.random.default_rng(0).normal(size=true.columns.shape)
    with_it = nearly + 2 * residual[:, :, None]
    suspect = Suspect("a scale error", "1", nearly, "", other=with_it)
    assert not followed(problem, fit.theta, exact.covariance, np.ones(2), [suspect])
    blamed = followed(
        problem,
        fit.theta,
        exact.covariance,
        np.ones(2),
        [suspect._replace(columns=with_it, other=None)],
    )
    assert blamed[0].share[0] > 0.9


@pytest.mark.parametrize(
    ("seed", "joints"),
    [(21, 1), *(pytest.param(k, 1, marks=pytest.mark.slow) for k in (71, 72)), (63, 3)],
)
def test_gentle_motion_with_slow_noise_is_no_scale_error(tmp_path, seed, joints):
    twin = healthy(two_joints([f"joint_{k}" for k in range(joints)]), seed)
    log = twin.write(tmp_path / "log.csv")
    found = identify_forces(twin.robot, log, known={"gain_1": twin.true["gain_1"]})
    assert not [f for f in found.findings if "a scale error" in f.text]


# -- whole logs -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ur5():
    return load_robot_model("ur5")


def outcome(robot, folder, seed: int = 0, flaw: Flaw | None = None, **options):
    """What a log is identified as, and identified parameters off by 3 half-widths and by 5 %."""
    values, true = arm_log(robot, seed, flaw, **options)
    log = write_csv(folder / "log.csv", values)
    found = identify_forces(robot, log, known={"gain_1": true["gain_1"]})
    off = []
    for p in found.parameters:
        if p.name not in true or p.status != "identified":
            continue
        low, high = p.value / (p.value / p.low) ** 3, p.value * (p.high / p.value) ** 3
        if not low <= true[p.name] <= high and abs(p.value / true[p.name] - 1) > 0.05:
            off.append(p.name)
    return found, off


FLAWS = {
    "one sine per joint": (Flaw(delay=0.015), {"sines": 1}, "", ""),
    "one slow sine per joint": (Flaw(delay=0.015), {"sines": 1, "fastest": 0.5}, "", ""),
    "delays that differ by 250 ms": (Flaw(delay=(0, 0.05, 0.1, 0.15, 0.2, 0.25)), {}, "", ""),
    "a delay that differs by 20 ms": (Flaw(delay=(0.01,) * 4 + (0.03, 0.01)), {}, "", ""),
    "a gear ratio of 2": (
        Flaw(ratio={4: 2.0}),
        {},
        "wrist_2_joint",
        "a scale error of its position",
    ),
    "half a gear ratio": (Flaw(ratio={2: 0.5}), {}, "elbow_joint", "a scale error of its position"),
    "a mount 20° off": (Flaw(tilt=np.deg2rad(20)), {}, "", "gravity across"),
    "an encoder 5° off": (Flaw(zero={1: np.deg2rad(5)}), {}, "shoulder_lift_joint", "an offset of"),
    "a lag of 30 ms": (Flaw(lag=0.03), {}, "", "the rate of all forces"),
    "a lag of 30 ms in fast motion": (Flaw(lag=0.03), {"fastest": 3.0}, "", "the rate of all"),
    "50 Hz": (Flaw(delay=0.015), {"rate": 50.0}, "", ""),
    "50 Hz and fast motion": (Flaw(delay=0.015), {"rate": 50.0, "fastest": 3.0}, "", ""),
}


SLOW = {"one slow sine per joint", "half a gear ratio", "an encoder 5° off", "50 Hz"}
SLOW |= {"delays that differ by 250 ms", "a lag of 30 ms in fast motion"}  # milder ones are here
MARKED = [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in FLAWS]


@pytest.fixture(scope="module")
def flawed(ur5, tmp_path_factory):
    """The outcome of a flaw, by its name."""

    @cache
    def found(name):
        flaw, options, *_ = FLAWS[name]
        return outcome(ur5, tmp_path_factory.mktemp("log"), 0, flaw, **options)

    return found


@pytest.mark.parametrize("name", MARKED)
def test_an_interval_holds_or_the_verdict_is_not_yes(flawed, name):
    _, _, where, words = FLAWS[name]
    found, off = flawed(name)
    assert not off or found.explains != "yes", off
    told = [f for f in found.findings if f.code == "residuals"]
    assert not words or any(f.where == where and words in f.text for f in told), told


def test_a_wrong_ratio_ends_a_yes_and_a_lag_widens_the_intervals(ur5, flawed):
    """The ratio's gain is beyond what one step corrects; the lag's effect is within it."""
    found, _ = flawed("a gear ratio of 2")
    assert found.explains == "partly" and "a scale error of its position" in found.verdict
    _, true = arm_log(ur5, 0, Flaw(lag=0.03))
    gains = flawed("a lag of 30 ms")[0].of("motor gain")
    assert max(abs(gain.value / true[gain.name] - 1) for gain in gains[:5]) > 0.02
    assert all(gain.low <= true[gain.name] <= gain.high for gain in gains)


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("the sign of its force", lambda u: np.where(u < 0, u / 0.8, u)),
        ("a dead zone of its force", lambda u: u + 0.2 * np.sign(u) * np.abs(u).mean()),
        ("its force times the time", lambda u: u * np.linspace(0.9, 1.1, len(u))),
    ],
)
def test_a_drive_that_is_no_multiple_of_its_command_is_told(tmp_path, words, change):
    robot = two_joints()
    values, true = arm_log(robot, 3)
    values["elbow_current"] = change(values["elbow_current"])
    log = write_csv(tmp_path / "log.csv", values)
    found = identify_forces(robot, log, known={"gain_1": true["gain_1"]})
    told = [f for f in found.findings if f.code == "residuals" and f.where == "elbow"]
    assert any(words in f.text for f in told), told
    gain = found.parameters[[p.name for p in found.parameters].index("gain_2")]
    assert found.explains == "partly" or gain.low <= true["gain_2"] <= gain.high


def test_gains_that_all_fade_are_told(tmp_path):
    """As with a battery that empties: in the end, every force needs 1.1 times the current."""
    robot = two_joints()
    values, true = arm_log(robot, 4)
    for name in robot.joints:
        values[f"{name}_current"] *= np.linspace(1.0, 1.1, len(values["time"]))
    found = identify_forces(
        robot, write_csv(tmp_path / "log.csv", values), known={"gain_1": true["gain_1"]}
    )
    told = [f for f in found.findings if f.code == "residuals" and not f.where]
    (share,) = [f.data["share"] for f in told if "all forces times the time" in f.text]
    assert isinstance(share, float) and share > 0.5


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_structure_that_is_right_is_not_doubted(ur5, tmp_path, seed):
    found, off = outcome(ur5, tmp_path, seed, Flaw(delay=0.015))
    assert found.explains == "yes" and not off, found.verdict
    assert all(gain.high < 1.15 * gain.value for gain in found.of("motor gain"))
    np.testing.assert_allclose([j.delay for j in found.joints], 0.015, atol=0.001)


# -- the choice of a structure --------------------------------------------------------------------


def rows_of(values: dict[str, np.ndarray]) -> JointRows:
    """Rows of a log of `arm_log` that needs no cleaning."""
    robot = two_joints()
    names = robot.joints
    q, u = (np.column_stack([values[f"{n}_{k}"] for n in names]) for k in ("position", "current"))
    t = values["time"]
    log = Log(t, q, np.gradient(q, t, axis=0), u)
    segment = LogSegment(log, np.ones(q.shape, bool), "log", (0, len(t)))
    rate = 1 / (t[1] - t[0])
    recordings = Recordings((segment,), rate, ("",) * len(names))
    return JointRows(robot, recordings, filter_for(recordings), np.ones(len(names)), 2.0)


def test_delays_are_found_to_a_fraction_of_the_grid():
    rows = rows_of(arm_log(two_joints(), 1, Flaw(delay=(0.013, 0.047)))[0])
    choice = choose(rows).choice
    np.testing.assert_allclose(choice.delay, [0.013, 0.047], atol=0.003)
    for seed in range(4):  # between two points of the grid, of which joints prefer either
        values = arm_log(two_joints(), seed, Flaw(delay=0.0141), sines=2, duration=10.0)[0]
        assert np.ptp(choose(rows_of(values)).choice.delay) == 0
    rows = rows_of(arm_log(two_joints(), 1, Flaw(delay=0.0137))[0])
    choice = choose(rows).choice
    far = replace(choice, delay=choice.delay + 0.01)
    for start in (choice, far):
        best, exact = with_exact_delays(rows, start)
        np.testing.assert_allclose(best.delay, 0.0137, atol=5e-4)
        assert all(low < 0.0137 < high for low, high in exact.ends(best.delay))


def test_dry_friction_of_another_speed_is_no_delay():
    """Until the speed is chosen, a delay of its own would imitate it."""
    (values, true), (exact, _) = (
        arm_log(two_joints(), 2, flaw, duration=8.0, fastest=0.5, noise=noise)
        for flaw, noise in ((Flaw(delay=0.012), 1e-5), (Flaw(), 0.0))
    )
    t = values["time"]
    v = np.interp(t + 0.012, t, np.gradient(exact["elbow_position"], t))
    slower = true["coulomb_2"] / true["gain_2"] * (np.tanh(v / 0.2) - np.tanh(v / 0.02))
    choice = choose(rows_of(values | {"elbow_current": values["elbow_current"] + slower})).choice
    assert np.ptp(choice.delay) == 0 and SPEEDS[choice.speed[1]] == 0.2


def test_an_offset_is_chosen_where_the_shared_fit_needs_it():
    values, _ = arm_log(two_joints(), 2)
    start = Choice((BASIC, BASIC), (BROAD, BROAD), np.zeros(2))
    for shift, wanted in ((0.0, 0), (0.8, 1)):
        moved = values | {"elbow_current": values["elbow_current"] + shift}
        choice, said = with_constants(rows_of(moved), start)
        assert ["offset" in c for c in choice.columns] == [False, bool(wanted)]
        assert len(said) == wanted


def test_load_friction_has_the_sign_of_the_speed():
    rows = rows_of(arm_log(two_joints(), 0, duration=10.0)[0])
    load, v = rows.diagonal["load"][2], rows.diagonal["viscous"]
    fast = np.abs(v) > 0.5
    assert (load[fast] * v[fast] >= 0).all() and np.abs(load[fast]).mean() > 0.1


def quantised(step: float, speed_noise: float = 0.0) -> Recordings:
    """A slow motion with positions in steps."""
    t = np.arange(4000) / 200
    q = np.round(0.5 * np.column_stack([np.sin(2 * t), np.sin(3 * t)]) / step) * step
    v = np.gradient(q, t, axis=0) + speed_noise * np.random.default_rng(0).standard_normal(q.shape)
    segment = LogSegment(Log(t, q, v, q), np.ones(q.shape, bool), "log", (0, len(t)))
    return Recordings((segment,), 200.0, ("", ""))


def test_steps_of_an_encoder_do_not_widen_the_filter():
    fine, coarse = (filter_for(quantised(step)).cutoff for step in (1e-6, 5e-3))
    assert fine == pytest.approx(coarse, rel=0.4) and coarse < 6


def test_rest_is_not_hidden_in_the_noise_of_a_velocity_column(tmp_path):
    from tests.clinic.logs.test_preparation import prepared

    t = np.arange(4000) / 200
    q, v, u = motion(np.clip(t - 2, 0, 16))
    v = np.where((t > 2)[:, None], v, 0.0)
    rng = np.random.default_rng(1)
    q = q + 1e-5 * rng.standard_normal(q.shape)
    v = v + rng.standard_normal(v.shape)
    named = {f"{n}{k}": x[:, k] for n, x in zip("qvu", (q, v, u), strict=True) for k in range(2)}
    (segment,) = prepared({"t": t} | named).segments
    assert np.mean(segment.usable) > 0.9
    assert segment.log.t[0] == pytest.approx(2, abs=0.2)


def test_a_gear_does_not_twist_by_more_than_gears_can(tmp_path):
    """Slow noise goes with the twist of a spring so soft that the link would swing by itself."""
    twin = healthy(two_joints(), 106)
    log = twin.write(tmp_path / "log.csv")
    found = identify_forces(twin.robot, log, known={"gain_1": twin.true["gain_1"]})
    assert not [f for f in found.findings if "elastic" in f.text]
    problem, true, _ = bent(0.8)
    fit, exact, _ = left_in(problem)
    for most, count in ((0.5, 0), (1.2, 1)):
        suspect = true._replace(most=most)
        left = followed(problem, fit.theta, exact.covariance, np.ones(2), [suspect])
        assert len(left) == count


def test_a_play_is_not_told_far_from_the_one_that_was_simulated():
    """How often a link crosses its play depends on the play; of one gear, one effect is named."""
    problem, true, _ = bent(0.8)
    fit, exact, _ = left_in(problem)

    def entered(*suspects):
        return followed(problem, fit.theta, exact.covariance, np.ones(2), suspects)

    assert not entered(true._replace(least=1.2))
    assert len(entered(true._replace(least=0.5))) == 1
    other = true._replace(words="another effect", columns=true.columns**3)
    assert len(entered(true._replace(part="gear"), other._replace(part="gear"))) == 1
    assert true._replace(part="gear").cause == other._replace(part="gear").cause
    assert true.cause != other.cause


def test_a_force_of_one_direction_is_not_weaker_in_the_other():
    """A rotor's was "weaker in one direction", with all of the variance."""
    t = np.linspace(0, 10, 500)
    for lowest, there in ((0.2, False), (-1.0, True)):
        force = np.maximum(np.sin(t), lowest)[:, None, None]
        said = [suspect.words for suspect in command_suspects(t, force, ["rotor"])]
        assert ("the sign of its force" in said) == there
