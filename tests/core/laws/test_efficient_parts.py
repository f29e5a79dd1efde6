"""The parts of the law `efficient` and of its misfit one by one, without a run of the filter."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.laws.efficient.covariance import innovate, predict, update
from nsaid_mj.core.laws.efficient.estimator import KalmanFilter
from nsaid_mj.core.laws.efficient.filter import (
    FilterConstants,
    FilterState,
    FilterWorkspace,
    filter_at,
)
from nsaid_mj.core.laws.efficient.kalman import _linear_share
from nsaid_mj.core.laws.efficient.state import EfficientState
from nsaid_mj.core.laws.efficient.steps import margin_of, project_inside
from nsaid_mj.core.laws.efficient.supervision import Supervision
from nsaid_mj.core.laws.settings import EfficientConfig
from nsaid_mj.core.log import Log
from nsaid_mj.core.nullspace.subspace import parts_of
from nsaid_mj.core.parameters import Array, Block, ParameterSpace
from nsaid_mj.core.quotient.cone import Cone
from nsaid_mj.core.structure.arrays import StructureArrays
from nsaid_mj.lab.evaluation import run_misfit
from nsaid_mj.watch import misfit
from nsaid_mj.watch.faults import snapshots as watching
from nsaid_mj.watch.faults import trials as trying
from nsaid_mj.watch.faults.events import event_of
from nsaid_mj.watch.faults.evidence import Jump
from nsaid_mj.watch.faults.hypotheses import (
    Hypothesis,
    everything,
    hypotheses_of,
    inexact,
    nothing,
)
from nsaid_mj.watch.faults.isolation import Isolation
from nsaid_mj.watch.faults.signals import signals_after, signals_under
from nsaid_mj.watch.faults.snapshots import Snapshot
from nsaid_mj.watch.faults.trials import Decision, Trials
from nsaid_mj.watch.misfit import whiteness
from nsaid_mj.watch.state import Kept, kept_of
from tests.support.plants import plant

# -- the filter's sample ---------------------------------------------------------------------------

P, N = 4, 2  # parameters and velocities
NOTHING: list[Any] = [
    np.zeros((0, size), dtype=np.int64) if size else np.zeros(0)
    for size in (12, 0, 0, 2, 3, 0, 4, 6, 0, 2)
]
NO_STRUCTURE = StructureArrays(*NOTHING)


def filter_and_constants(
    seed: int, gamma: float = 0.0, walk: float = 0.0
) -> tuple[FilterState, FilterConstants]:
    """A filter of three positive numbers and a free one, in the middle of a run."""
    rng, scale = np.random.default_rng(seed), np.array([0.5, 2.0, 10.0, 0.1])
    names, units = ("a", "b", "c"), ("1", "1", "1")
    space = ParameterSpace(
        (
            Block("gain", names, units, scale[:3], "positive"),
            Block("offset", ("d",), ("1",), scale[3:]),
        )
    )
    root = rng.standard_normal((2 * N + P, 2 * N + P))
    joint = 0.02 * root @ root.T
    theta = scale * np.array([1.5, 0.7, 1.0, 0.02])
    kalman = filter_at(np.zeros(N), np.zeros(N), theta, joint[2 * N :, 2 * N :].copy())
    kalman.Pxx[:], kalman.Pxt[:] = joint[: 2 * N, : 2 * N], joint[: 2 * N, 2 * N :]
    cone, walks = Cone.of(space), np.full(P, walk)
    return kalman, FilterConstants(
        NO_STRUCTURE,
        cone,
        scale,
        margin_of(cone, scale),
        gamma,
        10,
        walks,
        np.zeros(0),
        np.ones((1, P)),
    )


@pytest.mark.parametrize(("size", "share"), [(0.01, 1.0), (0.01, 0.25), (30.0, 1.0)])
def test_an_update_is_kalmans_then_projected_with_the_scale_carried_along(
    size: float, share: float
) -> None:
    """With Joseph's form for the gain that is applied, where a share of the step is taken."""
    for seed in range(5):
        kalman, constants = filter_and_constants(seed)
        rng = np.random.default_rng(seed)
        R, y = rng.uniform(0.05, 0.1, 2 * N), size * rng.standard_normal(2 * N)
        theta, Pxx, Pxt, Ptt = (np.array(a) for a in kalman[2:6])
        S = Pxx + np.diag(R)
        K, Kx = np.linalg.solve(S, Pxt).T, np.linalg.solve(S, Pxx).T
        free = theta + share * constants.scale * (K @ y)
        P_after = Ptt - share * (K @ Pxt + Pxt.T @ K.T) + share**2 * K @ S @ K.T
        workspace = FilterWorkspace.of(constants.structure, N, N, P)
        workspace.R[:], workspace.y[:] = R, y
        spread = innovate(constants.scale, kalman.Pxx, kalman.Pxt, workspace)
        square = workspace.e @ workspace.e
        update(
            constants.cone,
            constants.margin,
            constants.scale,
            constants.parts,
            kalman,
            share,
            workspace,
        )
        given = workspace.y
        out = not (free[:3] > 0).all()
        assert out == (size > 1)
        after = kalman.theta
        assert (after[:3] > 0).all()
        assert (after == pytest.approx(free, rel=1e-9)) == (not out)
        # the joint estimate moves along P: an error of θ that is learned corrects the state as well
        moved = (after - free) / constants.scale
        learned = np.linalg.solve(P_after, moved)
        np.testing.assert_allclose(given, Kx @ y + (Pxt - Kx @ Pxt) @ learned, rtol=1e-6, atol=1e-9)
        w = theta / constants.scale / np.sum((theta / constants.scale) ** 2)
        T = np.eye(P) + np.outer((after - theta) / constants.scale, w)
        np.testing.assert_allclose(kalman.Ptt, T @ P_after @ T.T, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(kalman.Pxt, (Pxt - Kx @ Pxt) @ T.T, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(kalman.Pxx, Pxx - Kx @ Pxx, rtol=1e-7, atol=1e-12)
        assert square == pytest.approx(y @ np.linalg.solve(S, y))
        assert spread == pytest.approx(np.linalg.slogdet(S)[1])


def test_a_prediction_carries_the_covariance_and_adds_linearisation_and_walk() -> None:
    gamma, walk, dt = 0.3, 0.04, 0.01
    kalman, constants = filter_and_constants(1, gamma, walk)
    rng = np.random.default_rng(0)
    F, B = rng.standard_normal((2 * N, 3 * N)), rng.standard_normal((N, P))
    _, Pxx, Pxt, Ptt = (np.array(a) for a in kalman[2:6])
    workspace = FilterWorkspace.of(constants.structure, N, N, P)
    workspace.F[:], workspace.B[:] = F, B
    predict(
        constants.scale,
        constants.walk,
        constants.unexplained,
        constants.gamma,
        dt,
        kalman,
        workspace,
    )
    joint = np.block([[Pxx, Pxt], [Pxt.T, Ptt]])
    Phi = np.hstack([F[:, : 2 * N], F[:, 2 * N :] @ B])
    effect = F[:, 2 * N :] @ B @ Ptt @ B.T @ F[:, 2 * N :].T
    expected = Phi @ joint @ Phi.T + gamma**2 * np.diag(np.diag(effect))
    np.testing.assert_allclose(kalman.Pxx, expected, rtol=1e-9)
    np.testing.assert_allclose(kalman.Pxt, Phi @ joint[:, 2 * N :], rtol=1e-9)
    relative = np.array([1.5, 0.7, 1.0, 0.1])  # that of a parameter near 0 is a tenth
    np.testing.assert_allclose(kalman.Ptt, Ptt + walk * dt * np.diag(relative**2), rtol=1e-12)


def test_a_projection_onto_one_number_is_that_of_the_constrained_minimum() -> None:
    """The nearest point of the half-space in the metric P⁻¹, from Lagrange's condition."""
    for seed in range(20):
        kalman, constants = filter_and_constants(seed)
        theta, bound = kalman.theta.copy(), 2 * constants.margin[1]
        theta[1] = -0.3 * constants.scale[1]
        gain = kalman.Ptt[:, 1] / kalman.Ptt[1, 1]
        nearest = theta + constants.scale * gain * (bound - theta[1]) / constants.scale[1]
        if not (nearest[[0, 2]] > constants.margin[[0, 2]]).all():
            continue
        start, y, work = kalman.theta, np.zeros(2 * N), (np.empty(P), np.empty(P), np.empty((P, P)))
        project_inside(
            constants.cone,
            constants.margin,
            start,
            theta,
            constants.scale,
            kalman.Ptt,
            kalman.Pxt,
            y,
            *work,
        )
        np.testing.assert_allclose(theta, nearest, rtol=1e-9)


@pytest.mark.parametrize("name", ["bluerov2", "f1tenth", "ur5"])
def test_a_step_keeps_half_of_the_mass_matrix_and_is_no_shorter_than_that_asks(name: str) -> None:
    """M(θ̂ + share δ) ≻ ½ M(θ̂), and not with twice the share unless that is 1."""
    made, shortened = plant(name), 0
    system, truth = made.system, made.truth
    space, n = system.space, system.n
    cone, scale = Cone.of(space), np.array(space.scale)
    constants = FilterConstants(
        system.forward,
        cone,
        scale,
        margin_of(cone, scale),
        0.3,
        10,
        np.zeros(system.p),
        np.zeros(0),
        parts_of(system),
    )
    for seed in range(30):
        rng = np.random.default_rng(seed)
        q, v, u = system.random_state(rng)
        kalman = filter_at(q, v, truth, np.eye(system.p))
        workspace = FilterWorkspace.of(constants.structure, n, len(q), system.p)
        workspace.step[:] = truth * 10 ** rng.uniform(-1, 1) * rng.standard_normal(system.p)
        share = _linear_share(constants, q, v, u, kalman, workspace)

        W_M = system.W_M(np.tile(np.concatenate([q, v]), (n, 1)), np.eye(n))

        def least(theta: np.ndarray, W_M: np.ndarray = W_M) -> float:
            return float(np.linalg.eigvalsh(W_M @ theta)[0])

        assert 0 < share <= 1
        assert least(0.5 * truth + share * workspace.step) > 0
        if share < 1:
            assert least(0.5 * truth + 2 * share * workspace.step) <= 0
            shortened += 1
    assert 0 < shortened < 30


# -- hypotheses and what is known after them -------------------------------------------------------


def test_all_of_theta_may_seem_off_by_a_little_or_by_a_fifth() -> None:
    made = plant("bluerov2")
    shares = [h.share for h in inexact(made.system, made.truth)]
    assert min(shares) < 1e-3 and max(shares) >= 0.1
    assert (np.diff(np.log10(shares)) <= 1).all()


def test_a_broken_actuator_is_at_a_command_of_zero_and_a_velocity_has_its_own_error() -> None:
    made = plant("bluerov2")
    what = hypotheses_of(made.system, made.truth)
    broken = [h for h in what if h.kind == "broken"][2]
    off = next(h for h in what if h.names == ("velocity 2",))
    events = [event_of(h, 1.0, 2.0, (0.3, 0.2, 0.4), 1.0) for h in (broken, off)]
    signals = signals_after(made.system, events)
    assert signals.held[broken.command] == 0 and np.isfinite(signals.held).sum() == 1
    assert np.flatnonzero(signals.bias).tolist() == [made.system.n + 1] == [off.channel]


def test_a_short_run_does_not_make_the_walk_fast() -> None:
    assert Kept(wander=(2e-4, 1e-4)).walk(0.1) == pytest.approx(1e-4)


def isolated(state: EfficientState, hypothesis: Hypothesis, size: Any) -> EfficientState:
    """What a verdict for a hypothesis makes of a state."""
    made = plant("bluerov2")
    trial = SimpleNamespace(
        reported=lambda _: (hypothesis, size),
        settled=lambda *_: (state.filter, signals_under(state.supervision.signals, hypothesis)),
        theta=state.filter.theta,
    )
    law: Any = SimpleNamespace(
        estimator=SimpleNamespace(system=made.system),
        _noted=lambda *given: Isolation._noted(law, *given),
    )
    log = Log.unchecked(np.array([3.0]), *np.zeros((3, 1, 1)))
    return Isolation._isolated(law, state, Decision(trial, 1.0), 2.0, log)  # type: ignore[arg-type]


def test_a_verdict_changes_factors_and_events_as_its_kind_demands() -> None:
    made = plant("bluerov2")
    system, truth = made.system, made.truth
    what = {h.kind: h for h in reversed(hypotheses_of(system, truth))}
    k = system.space.index(what["stuck"].names[0])
    kalman = filter_at(np.zeros(system.n), np.zeros(system.n), truth, np.eye(system.p))
    guard: Any = None
    start = EfficientState(kalman, guard, Supervision.none(system), calm=9.0, handed=True)
    size = (0.3, 0.2, 0.4)
    back = isolated(start, what["reversed"], size)
    told = back.supervision
    assert told.factors[k] == -1 and (told.factors == 1).sum() == system.p - 1
    assert [event.kind for event in told.events] == ["reversed"]
    assert back.calm == 0 and told.returns == 1
    kalman.theta[k] *= 0.5  # as the filter went on under the reversal
    stuck = isolated(back, what["stuck"], size)
    intact = kept_of(stuck).intact
    assert stuck.supervision.factors[k] == 0 and intact is not None
    assert intact[k] == truth[k]  # from before the first fault
    sound = what["stuck"]._replace(kind="sound")
    well = isolated(stuck, sound, (0.0, 0.0, 0.0))
    assert (well.supervision.factors == 1).all() and well.supervision.events == ()
    assert kept_of(well).wander == (0.0, 0.0)
    lost = isolated(start, what["loss"], size).supervision
    assert [event.kind for event in lost.events] == ["loss"]
    none = isolated(start, what["loss"], (0.3, -0.2, 0.8)).supervision
    assert none.events == () and (none.factors == 1).all()
    off = isolated(start, inexact(system, truth)[2], (0.0, 0.0, 0.0))
    assert off.supervision.events == () and off.calm == 0
    assert kept_of(off).wander == (0.02**2, 0.02**2)
    same = isolated(start, nothing(system), (0.0, 0.0, 0.0))
    assert same.calm == start.calm  # as if it had not been contradicted
    assert same.supervision.events == ()


def test_trials_are_repeated_along_logs_of_doubled_length(monkeypatch: pytest.MonkeyPatch) -> None:
    """All repetitions together are then along no more than twice the whole log."""
    window, lengths = 10, []
    tried: Any = SimpleNamespace(evidence=0.0)
    tried.followed = lambda *_: tried
    monkeypatch.setattr(trying, "_hopeful", lambda _, each: each)
    monkeypatch.setattr(
        trying, "_repeated", lambda one, _, trials, least: lengths.append(len(trials.log.t)) or one
    )
    log = Log(np.arange(101) * 0.01, *np.zeros((3, 101, 1)))
    estimator: Any = SimpleNamespace(constants=SimpleNamespace(window=window))
    trials = Trials((tried,), None, None, log.first(2), 1)  # type: ignore[arg-type]
    for end in range(window, 101, window):
        start = len(trials.log.t) - 1
        trials = trying.follow_trials(estimator, trials, log.part(start, end + 1))
        trials = trials._replace(samples=0)
    assert lengths == [11, 21, 41, 81]
    for later in (0.1, 0.2, 0.3):
        late = log.last(11)._replace(t=log.t[-11:] + later)
        trials = trying.follow_trials(estimator, trials, late)
        trials = trials._replace(samples=0)
    assert lengths[4:] == [111], "once after a second, whatever the length"


@pytest.mark.parametrize("piece", [1, 7, 50])
def test_trials_follow_the_same_blocks_however_samples_come(
    piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their bits, and a share of their cost, depend on the blocks."""
    followed: list[int] = []
    monkeypatch.setattr(trying, "_hopeful", lambda _, each: each)
    one: Any = SimpleNamespace(hypothesis=SimpleNamespace(offset=0.0, kind="loss"), evidence=0.0)
    one.followed = lambda _, part: followed.append(len(part.t) - 1) or one
    log = Log(np.arange(51) * 0.002, *np.zeros((3, 51, 1)))
    estimator: Any = SimpleNamespace(constants=SimpleNamespace(window=50))
    trials: Any = Trials((one,), None, None, log.first(1), 0)  # type: ignore[arg-type]
    for start in range(0, 50, piece):
        part = log.part(start, min(start + piece, 50) + 1)
        trials = trying.follow_trials(estimator, trials, part)
    assert followed == [10] * 5 and trials.reached == 50


def tried(hypothesis: Hypothesis, evidence: float) -> Any:
    """A trial whose innovations are those of chance."""
    kalman = filter_at(np.zeros(1), np.zeros(1), np.ones(1), np.eye(1))
    kalman.tally[1], kalman.noise.seen[0] = 100.0, 1000.0
    return SimpleNamespace(
        hypothesis=hypothesis,
        evidence=evidence,
        squares=100.0,
        filter=kalman,
        freed=lambda _: None,
        forgetting=lambda: None,
    )


def test_that_the_structure_is_not_exact_is_accepted_late_and_drops_no_single_fault() -> None:
    """With all of θ free anything is explained for a while."""
    made = plant("bluerov2")
    what = {h.kind: h for h in reversed(hypotheses_of(made.system, made.truth))}
    broad = inexact(made.system, made.truth)[-1]
    each = (
        tried(broad, 900.0),
        tried(what["payload"], 800.0),
        tried(what["loss"], 790.0),
        tried(what["friction"], 700.0),
        tried(nothing(made.system), 300.0),
    )
    log = Log(np.array([0.0, 0.01]), *np.zeros((3, 2, 1)))
    trials = Trials(each, None, None, log, 10)  # type: ignore[arg-type]
    estimator = KalmanFilter(made.system, 0.01, EfficientConfig())
    assert trying.verdict(estimator, trials, 0.11) is None
    late = trying.verdict(estimator, trials, 1.2)
    assert late is not None and late.trial is each[0]
    left = [trial.hypothesis.kind for trial in trying.narrowed(estimator, trials).each]
    assert left == ["none", "payload", "loss"]


def test_hopeless_faults_are_dropped_within_a_window_once_one_explains_the_motion() -> None:
    made = plant("bluerov2")
    what = {h.kind: h for h in reversed(hypotheses_of(made.system, made.truth))}
    free = everything(made.system, made.truth), inexact(made.system, made.truth)[-1]
    best, near, far = tried(what["loss"], 0.0), tried(what["bias"], -999.0), what["payload"]
    each = best, near, tried(far, -1001.0), tried(free[0], -5000.0), tried(free[1], 5000.0)
    estimator = KalmanFilter(made.system, 0.01, EfficientConfig())
    assert trying._hopeful(estimator, each) == (*each[:2], *each[3:])
    best.squares = 1e6
    assert trying._hopeful(estimator, each) == each, (
        "another one may have yet to learn a large change"
    )


def test_a_slow_change_that_leaves_no_covariance_is_rounding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After minutes of exact sensors P is singular to rounding along a healthy robot's motion."""
    made = plant("bluerov2")
    system, truth, scale = made.system, made.truth, made.system.space.scale
    k, p = int(system.space.actuators[2]), len(made.truth)
    P = 1e-8 * np.eye(p)
    after = truth.copy()
    after[k] += 0.05 * scale[k]
    kalman = filter_at(np.zeros(system.m), np.zeros(system.n), after, 0.5 * P)
    watch = tuple(Snapshot(t, truth, P, np.ones(2 * system.n)) for t in (0.0, 0.5))
    found = watching.slow_change(watch, kalman, system)
    assert found is not None and found.hypothesis.names == (system.space.names[k],)
    monkeypatch.setattr(watching, "with_jump", lambda *_: (np.zeros(p), np.diag([-1.0] * p)))
    assert watching.slow_change(watch, kalman, system) is None


# -- the misfit ------------------------------------------------------------------------------------


def test_the_mean_is_chi_square_of_one_degree() -> None:
    n = 4096
    found = whiteness(np.full((n, 2), np.sqrt(12 / n)) * np.array([1.0, 0.0]))
    cells = 2 * 11 * 2  # two families, 10 octaves and the mean, two channels
    assert found.period == np.inf and found.channel == 0
    assert found.chance == pytest.approx(cells * chi2.sf(12, 1))


def test_innovations_below_their_stated_size_are_no_misfit_whatever_their_colour() -> None:
    white = np.random.default_rng(3).standard_normal((4000, 3))
    e = uniform_filter1d(white, 20, axis=0) * np.sqrt(20)
    assert whiteness(0.2 * e).chance > 0.5
    assert whiteness(e).chance < 1e-4


def replayed(e: Array, *contradictions: float, innovations: float = 1.0) -> Any:
    """As much of a pass of the filter as is judged."""
    kalman = filter_at(np.zeros(1), np.zeros(1), np.zeros(1), np.eye(1))
    kalman.totals[:2] = innovations * e.size, e.size
    along = SimpleNamespace(innovation=e)
    return SimpleNamespace(contradictions=contradictions, along=along, filter=kalman)


def test_a_pass_is_judged_by_its_late_contradictions_its_size_and_its_colour() -> None:
    t = np.linspace(0, 30, 3001)
    log = Log.unchecked(t, *np.zeros((3, len(t), 1)))

    def level(*replay: Any, **more: float) -> str:
        return misfit._judged_pass(replayed(*replay, **more), log)[0].level

    for seed in range(10):
        assert level(np.random.default_rng(seed).standard_normal((3000, 4))) == "none"
    e = np.random.default_rng(0).standard_normal((3000, 4))
    assert level(e, 3.0, 5.0, 9.0) == "none"  # while the filter may still learn
    assert level(e, 3.0, 20.0) == level(e, innovations=1.5) == level(e + 0.15) == "some"
    assert level(e, 20.0, 21.0) == "contradicts"


def test_every_piece_between_faults_is_judged_under_the_signals_that_act() -> None:
    made = plant("bluerov2")
    what = {h.kind: h for h in reversed(hypotheses_of(made.system, made.truth))}
    t = np.linspace(0, 150, 1201)
    log = Log.unchecked(t, *np.zeros((3, len(t), 1)))
    events = [
        event_of(what[kind], begin, begin + 1, (0.3, 0.2, 0.4), 1.0)
        for kind, begin in (("loss", 50.0), ("reversed", 100.0))
    ]
    unknown = events[0]._replace(kind="unknown", time=60.0, found=61.0)
    scenario = SimpleNamespace(dt=t[1])
    faults = events[0], unknown, events[1]
    run = SimpleNamespace(system=made.system, faults=faults, scenario=scenario)
    found = list(run_misfit._pieces(run, log))  # type: ignore[arg-type]
    rows = [(240, 400), (409, 800), (809, 1201)]  # the last 120 s; none of an unknown change
    assert [(piece.start, piece.stop) for _, piece, _ in found] == rows
    assert [len(part.t) for part, *_ in found] == [end - start for start, end in rows]
    assert [(signals.sign == 1).all() for *_, signals in found] == [True, True, False]


def test_an_estimate_is_judged_inside_the_cone_with_gains_that_are_sound() -> None:
    made = plant("bluerov2")
    space, gains = made.system.space, made.system.space.actuators
    prior = Prior(space, made.truth, 0.3).draw(np.random.default_rng(0))
    theta = made.truth.copy()
    theta[gains[1]] *= -1
    theta[gains[2]] = 0.0
    found = misfit._sound(space, theta, prior)
    expected = made.truth.copy()
    expected[gains[2]] = prior[gains[2]]
    np.testing.assert_array_equal(found, expected)
    bodies = [place for block, place in space if block.geometry not in {"free", "positive"}]
    theta[bodies[0]] *= -1
    assert Cone.of(space).contains(misfit._sound(space, theta, prior))


@pytest.mark.parametrize("kept", [2, 1])
def test_a_shift_is_measured_by_what_was_learned(kept: int) -> None:
    """The second of two parameters moves by three deviations of what is learned of it."""
    scale, P0 = np.array([2.0, 5.0]), np.diag([0.04, 0.01])
    left = np.diag([0.04 * (1 if kept == 1 else 0.5), 0.01 * 0.1])
    moved = scale * np.array([0.0, 3 * np.sqrt(0.01 * 0.9)])
    rows = np.linspace(0, 1, 1601)[:, None] * moved + 1.0
    along = SimpleNamespace(theta=rows)
    ended = SimpleNamespace(Ptt=left, theta=np.ones(2))
    learning: Any = SimpleNamespace(contradictions=(), along=along, filter=ended)
    found = misfit._shifts(scale, np.ones(2), P0, learning)
    np.testing.assert_allclose(found, [9 / kept, 9 / 4 / kept, 9 / 16 / kept], rtol=1e-9)
    gains = Block("gain", ("a", "b"), ("1", "1"), scale, "positive", actuator=True)
    space = ParameterSpace((gains,))
    still: Any = SimpleNamespace(contradictions=(), filter=SimpleNamespace(theta=np.ones(2)))
    for energy in (0.0, 24.0):
        widening = misfit._widening(space, np.ones(2), P0, learning, still, energy)
        assert widening == pytest.approx(np.sqrt(max(1 + energy, 9 / kept)))
    apart = np.sqrt(0.04 * 2.0**2 + 0.01 * 5.0**2) / 2  # deviation of a gain over the mean of both
    for share in (1.0, 1e-2):  # of P: one gain shifts by 0.2 of the mean, the other by −0.2
        ended.theta = np.array([1.0, 1.5])
        shift = 0.2 / (np.sqrt(share) * apart)
        assert misfit.shift_of_gains(space, np.ones(2), share * P0, ended.theta) == (
            pytest.approx(shift)
        )
        widening = misfit._widening(space, np.ones(2), share * P0, learning, still, 0.0)
        assert (widening == pytest.approx(shift)) == (share < 1)
    still.filter.theta = np.array([1.0, 1.9])  # by 0.31 of the mean
    for still.contradictions, expected in (((), 0.9 / 2.9 / (0.1 * apart)), ((1.0,), shift)):
        widening = misfit._widening(space, np.ones(2), 0.01 * P0, learning, still, 0.0)
        assert widening == pytest.approx(expected)
    learning.contradictions = (1.0,)
    assert misfit._shifts(scale, np.ones(2), P0, learning) == []


def test_two_pieces_contradicted_once_each_contradict_the_structure() -> None:
    one = misfit.Misfit("some", (3.0,), 1.0, 10.0, 0.5, 1.0)
    none = misfit.Misfit("none", (), 2.0, 30.0, 0.01, 4.0)
    both = misfit.Misfit.worst([one, none])
    assert (both.level, both.innovations, both.seconds) == ("some", 1.75, 40.0)
    assert (both.chance, both.widening) == (0.01, 4.0)
    assert misfit.Misfit.worst([one, one]).level == "contradicts"


def test_a_change_is_evident_as_a_whole_even_where_its_parts_trade() -> None:
    trade = np.array([[1.0, -0.999], [-0.999, 1.0]])  # each to ±1, their sum to ±0.045
    assert Jump(0.0, np.array([0.3, 0.3]), trade).evident
    assert not Jump(0.0, np.array([0.6, -0.6]), trade).evident
    assert not Jump(0.0, np.zeros(2), trade).evident
