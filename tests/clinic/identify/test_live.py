"""Live identification: the same bits as a law along a log, and samples that are not in order."""

import io
import json
import signal
from concurrent.futures import CancelledError
from dataclasses import replace
from pathlib import Path

import numpy as np
import orjson
import pytest
from scipy.spatial.transform import Rotation

import nsaid_mj
from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.clinic.identify.measured import LiveRobot, measured_scenario
from nsaid_mj.clinic.live import _LINE
from nsaid_mj.clinic.logs.stream import Cleaner, parsed, sample_of, turned
from nsaid_mj.clinic.session import EstimateStream, LiveEstimate, Session
from nsaid_mj.core.laws.base import Confidence
from nsaid_mj.core.log import Log
from nsaid_mj.lab.evaluation.run_misfit import filter_of
from nsaid_mj.lab.evaluation.running import RunningMisfit
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import Run
from nsaid_mj.lab.postprocessing import finish, rebuild
from nsaid_mj.lab.record import Record
from nsaid_mj.lab.setup import Setup
from nsaid_mj.watch import Misfit, widened

RATE = 100.0
BLUEROV = LiveRobot(robot="bluerov2")


@pytest.fixture(scope="module")
def log() -> Log:
    """Six seconds of a BlueROV2 with noisy sensors."""
    scenario = replace(load("bluerov2"), duration=6.0, dt=1 / RATE, sensors="noisy")
    setup = Setup.of(scenario)
    with setup.plant.running():
        return setup.simulate()


def session(law: str = "efficient", frame: str = "ENU/FLU") -> Session:
    return Session(measured_scenario(BLUEROV, law, RATE, (1e-4, 5e-3), 0.3), frame)


def line(t: float, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> bytes:
    parts = {"t": float(t), "q": q.tolist(), "v": v.tolist(), "u": u.tolist()}
    return json.dumps(parts).encode() + b"\n"


def lines(log: Log) -> list[bytes]:
    return [line(*log.at(k)) for k in range(len(log.t))]


@pytest.mark.parametrize("law", ["efficient", "memory", "cone"])
def test_a_stream_gives_the_bits_of_the_law_along_the_log(law: str, log: Log, tmp_path: Path):
    live = session(law)
    run = live.run(io.BytesIO(b"".join(lines(log))), tmp_path, lambda _: None, every=0.05)
    identifier = live.identifiers[""]
    _, along = identifier.follow(identifier.init(log.at(0)), log)
    assert np.array_equal(run.record["theta_hat"], along.theta_hat)
    assert np.array_equal(run.record["v_hat"], along.v_hat)
    assert run.stream["used"] == len(log.t) and run.stream["gaps"] == 0


def test_no_interval_is_stated_while_the_motion_contradicts_the_structure(log: Log, tmp_path: Path):
    """Live, gains of simulated arms missed their intervals by up to 37 times the half-width."""

    def gains(log: Log) -> tuple[Run, list[bool], list[bool]]:
        """The run, and by estimate whether the motion contradicts, and there are intervals."""
        shown: list[LiveEstimate] = []
        run = session().run(io.BytesIO(b"".join(lines(log))), tmp_path, shown.append, every=0.5)
        stated = [bool(np.isfinite([g.high for g in one.gains]).all()) for one in shown]
        return run, [one.misfit == "contradicts" for one in shown], stated

    _, contradicts, stated = gains(log)
    assert not any(contradicts) and stated == [False, False] + [True] * (len(stated) - 2)
    run, contradicts, stated = gains(log._replace(u=np.roll(log.u, 30, axis=0)))
    assert any(contradicts) and not any(np.array(stated) & contradicts)
    state = run.states[""]
    forgiven = state._replace(own=state.own._replace(calm=0.7 * state.t))
    assert Misfit.during(state) == "contradicts" != Misfit.during(forgiven)


@pytest.mark.parametrize("law", ["efficient", "memory", "cone"])
def test_a_law_follows_slow_samples(law: str, log: Log, tmp_path: Path):
    """Below 8 Hz `identify --law memory` asked for a smaller K, which no flag sets."""
    slow = Log(*(part[::14] for part in log))
    scenario = measured_scenario(BLUEROV, law, RATE / 14, (1e-4, 5e-3), 0.3)
    run = Session(scenario).run(io.BytesIO(b"".join(lines(slow))), tmp_path, lambda _: None)
    assert run.stream["used"] == len(slow.t)


def test_what_is_out_of_order_is_dropped_and_counted(log: Log, tmp_path: Path):
    whole = lines(log)
    bad = line(log.t[151] + 1e-4, log.q[151] * np.nan, log.v[151], log.u[151])
    spoilt = [*whole[:100], whole[99], whole[50], *whole[100:152], bad, b"garbage\n", *whole[152:]]
    clean, dirty = session(), session()
    first = clean.run(io.BytesIO(b"".join(whole)), tmp_path / "a", lambda _: None)
    second = dirty.run(io.BytesIO(b"".join(spoilt)), tmp_path / "b", lambda _: None)
    assert np.array_equal(first.record["theta_hat"], second.record["theta_hat"])
    wrong = {"duplicates": 1, "late": 1, "not_finite": 1, "unreadable": 1}
    assert second.stream == first.stream | wrong


@pytest.mark.parametrize("law", ["efficient", "memory", "paper"])
def test_a_law_goes_on_after_a_gap_as_it_was(law: str, log: Log, tmp_path: Path):
    kept = lines(log)[:300] + lines(log)[370:]
    live = session(law)
    run = live.run(io.BytesIO(b"".join(kept)), tmp_path, lambda _: None)
    assert (run.stream["gaps"], run.stream["missing"]) == (1, 70)
    theta = run.record["theta_hat"]
    assert len(theta) == len(kept)
    assert np.array_equal(theta[299], theta[300])
    assert np.array_equal(run.record["v_hat"][300], log.v[370])
    assert not run.faults


def test_result_and_page_tell_the_gap_and_judge_around_it(log: Log, tmp_path: Path):
    kept = lines(log)[:300] + lines(log)[370:]
    run = session().run(io.BytesIO(b"".join(kept)), tmp_path, lambda _: None)
    summary = finish(run).summary()
    assert summary["stream"]["missing"] == 70
    assert summary["misfit"] != "contradicts" and summary["misfit_contradictions"] == []
    assert "1 gap, 70 samples missing in it" in (tmp_path / "report.html").read_text("utf-8")
    assert "theta_perp_ratio" not in summary  # no truth is known


def test_a_killed_live_run_is_rebuilt_from_its_record(log: Log, tmp_path: Path):
    run = session().run(io.BytesIO(b"".join(lines(log))), tmp_path, lambda _: None)
    first = finish(run)
    (tmp_path / "summary.json").unlink()
    again = rebuild(tmp_path)
    assert [row.estimate for row in again.estimates] == [row.estimate for row in first.estimates]
    assert Record.read(tmp_path).complete


@pytest.mark.parametrize(
    "given,name",
    [
        (b'{"t": 0, "q": [1], "v": [1], "u": [1]}\n' * 20, "q"),
        (b"q1,q2\n" * 20, "sample"),
        (b"", "stream"),
        (b'{"end": true}\n', "stream"),
    ],
)
def test_a_stream_of_no_samples_is_refused_by_name(given: bytes, name: str, tmp_path: Path):
    with pytest.raises(InvalidInput) as error:
        session().run(io.BytesIO(given), tmp_path, lambda _: None)
    assert error.value.name == name


@pytest.mark.parametrize("part", [10**400, [10**400], {}, "x"])
def test_a_part_that_is_no_number_is_refused_by_name(part):
    system = session().robot.system
    with pytest.raises(InvalidInput) as error:
        sample_of(system, part, np.zeros(system.m), np.zeros(system.n), np.zeros(system.n_u))
    assert error.value.name == "t" and len(str(error.value)) < 300
    nested = b'{"t":' * 20_000
    with pytest.raises(InvalidInput, match="sample"):
        parsed(system, nested)


def test_columns_of_a_table_are_samples_that_can_be_sent():
    system = session().robot.system
    q, v, u = (np.ones((n, 3))[:, 1] for n in (system.m, system.n, system.n_u))
    at, *parts = sample_of(system, 0.5, q, v, u)
    sent = orjson.dumps({"t": at} | dict(zip("qvu", parts, strict=True)), option=_LINE)
    read = parsed(system, sent)
    assert read is not None and read[0] == 0.5
    assert all(np.array_equal(a, b) for a, b in zip(read[1:], (q, v, u), strict=True))


def test_a_time_beyond_all_numbers_is_dropped_and_counted():
    system = session().robot.system
    cleaner, rest = Cleaner(system, RATE), (np.zeros(system.m), np.zeros(system.n), np.zeros(1))
    times = (-1e308, 1e308, -1e308 + 1e300, 1e307)
    assert [cleaner.accept(t, *rest) is None for t in times] == [False, True, False, True]
    assert cleaner.counts.not_finite == 2 and cleaner.counts.used == 2


def test_a_wrong_rate_is_refused(log: Log, tmp_path: Path):
    slow = b"".join(line(3 * t, *rest) for t, *rest in (log.at(k) for k in range(200)))
    with pytest.raises(InvalidInput) as error:
        session().run(io.BytesIO(slow), tmp_path, lambda _: None)
    assert error.value.name == "rate" and "33" in str(error.value.got)


def test_poses_in_ned_are_turned_as_matrices_are():
    system = session().robot.system
    to_enu, to_flu = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1.0, -1, -1])
    rng = np.random.default_rng(0)
    turn, place = Rotation.random(rng=rng), rng.standard_normal(3)
    twist = rng.standard_normal(6)
    q, v = turned(system, np.concatenate([place, turn.as_quat()]), twist)
    expected = Rotation.from_matrix(to_enu @ turn.as_matrix() @ to_flu)
    assert np.allclose(Rotation.from_quat(q[3:]).as_matrix(), expected.as_matrix(), atol=1e-12)
    assert np.allclose(q[:3], to_enu @ place)
    assert np.allclose(v, np.concatenate([to_flu @ twist[:3], to_flu @ twist[3:]]))


def test_a_frame_must_be_known_and_make_sense():
    with pytest.raises(UnknownName):
        Cleaner(session().robot.system, RATE, "NED")
    arm = LiveRobot(robot="z1").known().system
    with pytest.raises(InvalidInput, match="fixed base"):
        Cleaner(arm, RATE, "NED/FRD")


def test_the_python_interface_records_the_same_bits(log: Log, tmp_path: Path):
    log = log.first(250)
    with nsaid_mj.live("bluerov2", rate=RATE, prior_error=0.3, out=tmp_path / "live") as identifier:
        for k in range(len(log.t)):
            identifier.update(*log.at(k))
        last = identifier.wait(len(log.t))
        with pytest.raises(InvalidInput, match="v: expected 6 numbers"):
            identifier.update(0.0, log.q[0], log.v[0][:5], log.u[0])
    live = session()
    run = live.run(io.BytesIO(b"".join(lines(log))), tmp_path / "file", lambda _: None)
    record = Record.read(tmp_path / "live")
    assert np.array_equal(record["theta_hat"], run.record["theta_hat"])
    assert last is not None and np.array_equal(last.theta_hat, record["theta_hat"][-1])
    assert all(gain.low <= gain.value <= gain.high for gain in last.gains)
    assert identifier.summary["status"] == "completed"
    assert (tmp_path / "live" / "report.html").is_file()


@pytest.mark.parametrize("piece", [1, 7, 25])
def test_the_motion_so_far_is_judged_each_time_it_is_half_as_long_again(piece: int, log: Log):
    """As after the run; stated at 7/5 of the duration, whatever the samples' arrival."""
    live, noise = session(), np.random.default_rng(0)
    log = log._replace(u=log.u + 0.004 * noise.standard_normal(log.u.shape))
    own, widenings = live.identifiers[""], []
    misfit = RunningMisfit(live.scenario, own, live.robot.prior)
    state, found = own.init(log.at(0)), {}
    misfit.see(log.first(1), state)
    for k in range(0, 300, piece):
        state, _ = own.follow(state, log.part(k, k + piece + 1))
        misfit.see(log.part(k + 1, k + piece + 1), state)
        found[round(state.t, 2)] = misfit.deviations(state), state, own.confidence(state)
    misfit.stop()
    alone, space = filter_of(live.scenario, live.robot.system), live.robot.system.space
    assert alone is not None
    for duration in 0.5 * 1.5 ** np.arange(4):
        k = -(-int(np.ceil(duration * RATE - 1e-9)) // piece) * piece
        at, _ = own.follow(own.init(log.at(0)), log.first(k + 1))
        stated = own.confidence(at)
        given = at.theta_hat, stated, live.robot.prior, log.first(k + 1)
        expected = Misfit.of_estimate(alone, *given)
        widenings.append(expected.widening)
        late = 1.4 * duration + 1.5 / RATE
        deviations, state, of_law = found[min(t for t in found if t > late)]
        if expected.level == "contradicts":
            assert np.isinf(deviations).all()
        else:
            least = expected.widening * Confidence.of_gains(stated, at.theta_hat, space)
            wider = widened(of_law, expected.widening)
            now = Confidence.of_gains(wider, state.theta_hat, space)
            np.testing.assert_array_equal(deviations, np.maximum(now, least))
    assert np.isinf(found[min(found)][0]).all() and max(widenings) > 1


def test_a_log_is_judged_no_further_once_another_begins(log: Log):
    """The next judgement would wait for it, and the samples with it."""
    live = session()
    misfit = RunningMisfit(live.scenario, live.identifiers[""], live.robot.prior)
    given = live.robot.prior, None, live.robot.prior, log
    assert misfit._judgement(misfit._log, *given).seconds == pytest.approx(6.0)
    misfit.stop()
    with pytest.raises(CancelledError):
        misfit._judgement(misfit._log - 1, *given)


def test_after_a_gap_another_log_is_judged(log: Log):
    """A log that spans the gap would contradict every structure."""
    live = session()
    own, (begin, end) = live.identifiers[""], (200, 285)
    misfit = RunningMisfit(live.scenario, own, live.robot.prior)
    state, _ = own.follow(own.init(log.at(0)), log.first(80))
    misfit.see(log.first(80), state)
    before, later = misfit.deviations(state), log.part(begin, end)
    state = own.resume(state, later.at(0))
    misfit.see(later.first(1), state)
    for k in range(0, len(later.t) - 1, 10):
        state, _ = own.follow(state, later.part(k, k + 11))
        misfit.see(later.part(k + 1, k + 11), state)
        if k + 10 == 50:
            at = state
    misfit.stop()
    alone = filter_of(live.scenario, live.robot.system)
    assert alone is not None and np.isinf(before).all()
    given = at.theta_hat, own.confidence(at), live.robot.prior, later.first(51)
    expected, of_law = Misfit.of_estimate(alone, *given), own.confidence(state)
    assert of_law is not None and expected.level != "contradicts"
    space, wider = live.robot.system.space, widened(of_law, expected.widening)
    least = expected.widening * Confidence.of_gains(own.confidence(at), at.theta_hat, space)
    now = Confidence.of_gains(wider, state.theta_hat, space)
    np.testing.assert_array_equal(misfit.deviations(state), np.maximum(now, least))


def test_ctrl_c_while_kernels_are_loaded_ends_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended the short run that loads them alone, and samples were waited for then."""
    raised = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(EstimateStream, "start", lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        with pytest.raises(KeyboardInterrupt):
            session("paper").warm_up()
    finally:
        signal.signal(signal.SIGINT, raised)
