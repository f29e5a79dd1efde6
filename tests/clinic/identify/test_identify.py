"""`identify` on a real arm's log, and on simulated logs with the faults that real ones have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import nsaid_mj as ns
from nsaid_mj.base.errors import BadRun, InvalidInput, UnknownName
from nsaid_mj.cli.commands import command
from nsaid_mj.clinic.identify.calibrate import calibrate
from nsaid_mj.clinic.identify.fit import minimise, tempered, tempered_fit
from nsaid_mj.clinic.identify.identify import coupled, identify_forces
from nsaid_mj.clinic.identify.problem import FitProblem, least_squares
from nsaid_mj.clinic.identify.result import Identification, Options
from nsaid_mj.clinic.logs.mapping import Map, MotorCoupling
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import read_tables
from scripts.calibration import essential
from tests.support.robot_logs import columns, two_joints, write_csv
from tests.support.simulated_logs import Simulated, nominal_model


@pytest.fixture(scope="module")
def tx40() -> Identification:
    return identify_forces("tx40")


@pytest.fixture(scope="module")
def again() -> tuple[Identification, FitProblem]:
    """Once more, with the problem that is fitted."""
    problems: list[FitProblem] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "nsaid_mj.clinic.identify.calibrate.tempered_fit",
            lambda p: (problems.append(p), tempered_fit(p))[1],
        )
        return identify_forces("tx40"), problems[0]


def test_the_structure_explains_the_real_log(tx40):
    assert tx40.explains == "yes" and tx40.verdict.startswith("The structure explains the log")
    for joint in tx40.joints:
        assert joint.held_out < 0.2
        assert joint.held_out <= 1.05 * joint.least_squares


def test_three_folds_of_the_real_log_are_predicted_as_well_as_by_least_squares(again):
    """At most 1.05 of weighted least squares in 15 of 18 joint-folds, 1.1 in all."""
    _, problem = again
    _, share = tempered_fit(problem)
    N, ratios = len(problem.t), []
    for part in (np.arange(4 * N // 5, N), np.arange(N // 5), np.arange(2 * N // 5, 3 * N // 5)):
        rest, own = (problem.select(rows) for rows in (np.delete(np.arange(N), part), part))
        theta = minimise(rest, tempered(rest, share)).theta
        plain = least_squares(rest, theta[problem.space.actuators])
        ratios += (own.nrmse(theta) / own.nrmse(plain)).tolist()
    assert len(ratios) == 18
    assert np.sum(np.array(ratios) <= 1.05) >= 15 and max(ratios) <= 1.1


def test_published_essential_parameters_of_the_real_arm_are_found():
    """Gears given: within three published deviations or 10 %, over fv1, at least 20 of 24."""
    table = essential()
    assert len(table) >= 24 and sum(agrees for *_, agrees in table.values()) >= 20


def test_free_gains_of_the_real_arm_hold_in_their_intervals_or_are_flagged(tx40):
    """The maker's torque constants are true: every gain is 1."""
    gains = tx40.of("motor gain")
    for gain in gains:
        assert gain.low <= 1.0 <= gain.high
    assert {g.status for g in gains[4:]} == {"only in combination"}
    for gain in gains[:3]:
        assert gain.value == pytest.approx(np.mean([g.value for g in gains[:3]]), rel=0.1)


def test_the_same_log_gives_the_same_bits(tx40, again):
    np.testing.assert_array_equal(again[0].theta, tx40.theta)


# -- simulated logs ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated() -> Simulated:
    return Simulated("ur5", 0, 20.0)


def outcome(simulated: Simulated, path: Path, **options):
    return identify_forces(nominal_model(simulated, 0), path, **options)


def test_gains_of_a_simulated_arm_are_found_and_covered(simulated, tmp_path):
    """Quantised currents, jitter, a gap, load friction, an offset, a delay, unknown σ."""
    path = simulated.write(tmp_path / "log.csv")
    found = outcome(simulated, path, known={"gain_1": float(simulated.gain[0])})
    assert found.explains == "yes"
    gains = found.of("motor gain")
    ratio = np.array([g.value for g in gains]) / simulated.gain
    sure = np.array([g.status != "only in combination" for g in gains])
    assert sure.sum() >= 5 and (np.abs(ratio - 1)[sure] < 0.05).all()
    inside = [g.low <= k <= g.high for g, k in zip(gains, simulated.gain, strict=True)]
    assert np.sum(inside) >= 5
    delays = [joint.delay for joint in found.joints]
    np.testing.assert_allclose(delays, 0.016, atol=0.002)  # 15 ms, and half a held sample
    assert {"gap"} <= {f.code for f in found.findings}


def test_thinned_rows_of_a_long_log_give_gains_that_are_covered(simulated, tmp_path, monkeypatch):
    """With a third of its rows, as a log of some 20 minutes is fitted."""
    monkeypatch.setattr("nsaid_mj.clinic.identify.choose.cutoff._MOST_ROWS", 400)
    path, known = simulated.write(tmp_path / "log.csv"), {"gain_1": float(simulated.gain[0])}
    found = outcome(simulated, path, known=known)
    gains = found.of("motor gain")
    assert found.explains == "yes"
    assert sum(g.low <= k <= g.high for g, k in zip(gains, simulated.gain, strict=True)) >= 5


def test_each_fault_of_a_log_is_named(simulated, tmp_path):
    """None of them ends with a result."""
    u, q = simulated.u, simulated.q
    swapped = u.copy()
    swapped[:, [1, 2]] = u[:, [2, 1]]
    flat = u.copy()
    flat[:, 2] = 0.0
    faults = {
        "reversed_sign": {"u": u * np.array([1, 1, -1, 1, 1, 1.0])},
        "swapped": {"u": swapped},
        "degrees": {"q": np.rad2deg(q)},
        "dead_channel": {"u": flat},
    }
    for code, changes in faults.items():
        path = simulated.write(tmp_path / f"{code}.csv", **changes)
        with pytest.raises(ns.UnusableLog) as told:
            outcome(simulated, path)
        codes = {f.code for f in told.value.findings if f.level == "refusal"}
        assert code in codes, (code, codes)


def massless(folder: Path) -> tuple[str, dict[str, np.ndarray]]:
    """The path of a URDF without <inertial>, and a log with gains 1 and 2."""
    text = '<robot name="light"><link name="base"/>'
    for parent, name in (("base", "shoulder"), ("shoulder_link", "elbow")):
        text += (
            f'<link name="{name}_link"/><joint name="{name}" type="revolute">'
            f'<parent link="{parent}"/><child link="{name}_link"/><origin xyz="0.4 0 0"/>'
            '<axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="99" velocity="9"/>'
            "</joint>"
        )
    (folder / "light.urdf").write_text(text + "</robot>")
    values = columns(duration=20)
    model = two_joints().model
    q, v = (np.column_stack([values[f"{n}{k}"] for k in (1, 2)]) for n in ("q", "dq"))
    a, data = np.gradient(v, values["t"], axis=0), model.createData()
    force = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    force = force + v + 0.5 * np.tanh(v / 0.02)
    return str(folder / "light.urdf"), values | {"tau1": force[:, 0], "tau2": force[:, 1] / 2}


def test_a_model_without_masses_gives_ratios_only_until_a_gain_is_known(tmp_path):
    model, values = massless(tmp_path)
    log = write_csv(tmp_path / "log.csv", values)
    free = identify_forces(model, log)
    assert "no_masses" in {f.code for f in free.findings} and "only ratios" in free.anchor
    assert all(gain.high > 100 * gain.low for gain in free.of("motor gain"))
    one, other = identify_forces(model, log, known={"gain_1": 1.0}).of("motor gain")
    assert one.value == 1.0 and other.low < 2.0 < other.high and other.high < 4.0


def test_commands_in_newton_metres_fix_the_scale_of_a_model_without_masses(tmp_path):
    model, values = massless(tmp_path)
    values["tau1 [Nm]"], values["tau2 [Nm]"] = values.pop("tau1"), 2 * values.pop("tau2")
    found = identify_forces(model, write_csv(tmp_path / "log.csv", values))
    assert all(gain.low < 1.0 < gain.high and gain.high < 2.0 for gain in found.of("motor gain"))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_joint_at_rest_throughout_is_told_and_the_others_are_identified(tmp_path):
    values = columns(duration=20)
    values["q2"] = 1e-5 * np.random.default_rng(0).standard_normal(len(values["t"]))
    del values["dq1"], values["dq2"]
    found = identify_forces(two_joints(), write_csv(tmp_path / "log.csv", values))
    assert ("at_rest", "elbow") in [(f.code, f.where) for f in found.findings]
    assert np.isfinite(found.deviation).all()


def test_an_arm_with_one_joint_is_identified(tmp_path):
    robot, values = two_joints(("shoulder",)), columns(duration=20, n=1)
    q, v = values["q1"][:, None], values["dq1"][:, None]
    a, data = np.gradient(v, values["t"], axis=0), robot.model.createData()
    rows = zip(q, v, a, strict=True)
    force = np.array([pin.rnea(robot.model, data, *row) for row in rows]) + v
    values["tau1"] = force[:, 0] / 2
    found = identify_forces(robot, write_csv(tmp_path / "log.csv", values))
    (gain,), (viscous,) = found.of("motor gain"), found.of("viscous friction")
    assert found.explains != "no"
    assert gain.low < 2 < gain.high and viscous.low < 1 < viscous.high


def test_noise_is_no_reversed_command(tmp_path):
    values = columns(duration=20)
    rng = np.random.default_rng(7)
    values |= {f"tau{k}": rng.standard_normal(len(values["t"])) for k in (1, 2)}
    found = identify_forces(two_joints(), write_csv(tmp_path / "log.csv", values))
    assert found.explains == "no"


def test_a_short_file_is_named(simulated, tmp_path):
    path = simulated.write(tmp_path / "log.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:600]) + "\n")
    with pytest.raises(ns.UnusableLog) as told:
        outcome(simulated, path)
    assert "short_log" in {f.code for f in told.value.findings}


def test_milliamperes_are_named(simulated, tmp_path):
    """Refused where the column states another unit; else gains are per unit of the column."""
    path = simulated.write(tmp_path / "log.csv", u=simulated.u * 1000)
    found = outcome(simulated, path, columns=["viscous"], delay=0.0)
    assert "milliamps" in {f.code for f in found.findings}
    path.write_text(path.read_text().replace("_current", "_torque_Nm"))
    with pytest.raises(ns.UnusableLog) as told:
        outcome(simulated, path)
    assert {"unit", "milliamps"} & {f.code for f in told.value.findings if f.level == "refusal"}


# -- input -------------------------------------------------------------------------------------


def test_a_model_without_a_log_is_refused():
    with pytest.raises(InvalidInput, match="--log"):
        identify_forces("ur5")


@pytest.mark.parametrize("words", [("identify", "tx40"), ("inspect", "log.csv")])
@pytest.mark.parametrize("out", ["file", "file/below"])
def test_a_folder_that_cannot_be_is_refused_before_the_work(tmp_path, words, out):
    (tmp_path / "file").touch()
    with pytest.raises(BadRun, match="a file, not a folder"):
        command([*words, "--out", str(tmp_path / out)])


def test_a_mistyped_robot_is_told_before_a_missing_log():
    with pytest.raises(UnknownName, match="tx40"):
        identify_forces("tx4")


@pytest.mark.parametrize("column,sign", [(1, 1.0), (4, -1.0)])
def test_a_coupling_of_any_two_joints_has_the_sign_of_its_motor(column, sign):
    """A motor that turns by v_6 ± v_c: row 6 of the matrix of positions."""
    R = np.diag([32.0, 32, 45, -48, 45, -32])
    R[5, column] = sign * R[5, 5]
    mapping = Map(coupling=MotorCoupling(position=tuple(map(tuple, R.tolist()))))
    assert coupled(mapping) == ((column, 5, int(sign)),)
    torque = Map(coupling=MotorCoupling(torque=tuple(map(tuple, R.T.tolist()))))
    assert coupled(torque) == ((column, 5, int(sign)),)


@pytest.mark.parametrize("i,j,sign", [pytest.param(0, 2, 1, marks=pytest.mark.slow), (1, 2, -1)])
def test_friction_of_a_coupled_motor_is_found(simulated, tmp_path, i, j, sign):
    """A further motor's Coulomb friction of 5 N·m, whose speed is v_i ± v_j."""
    robot = nominal_model(simulated, 0)
    recordings = prepare(read_tables([simulated.write(tmp_path / "log.csv")]), None, robot)
    changed = []
    for segment in recordings.segments:
        log, u = segment.log, segment.log.u.copy()
        friction = 5.0 * np.tanh((log.v[:, i] + sign * log.v[:, j]) / 0.05)
        u[:, i] += friction / simulated.gain[i]
        u[:, j] += sign * friction / simulated.gain[j]
        changed.append(segment._replace(log=log._replace(u=u)))
    recordings = replace(recordings, segments=tuple(changed))
    options = Options(frozenset({"rotor", "viscous", "coulomb"}), ((i, j, sign),))
    known = {f"gain_{k + 1}": float(gain) for k, gain in enumerate(simulated.gain)}
    found = calibrate(robot, recordings, options=replace(options, known=known))
    value = next(p.value for p in found.parameters if p.name == f"coupling_coulomb_{i + 1}_{j + 1}")
    assert value == pytest.approx(5.0, rel=0.15)


def test_an_unknown_column_is_refused_with_the_known_ones(tmp_path):
    log = write_csv(tmp_path / "log.csv", columns())
    with pytest.raises(UnknownName, match="viscous"):
        identify_forces(two_joints(), log, columns=["viscose"])


@pytest.mark.parametrize("delay", [[0.1, 0.2, 0.3], float("nan"), 3.0])
def test_delays_that_cannot_be_are_refused(delay, tmp_path):
    log = write_csv(tmp_path / "log.csv", columns())
    with pytest.raises(InvalidInput, match="delay"):
        identify_forces(two_joints(), log, delay=delay)


def test_parameters_of_a_joint_that_is_not_explained_have_wide_intervals(simulated, tmp_path):
    """A command that is noise explains nothing, whatever a fit makes of it."""
    rng = np.random.default_rng(0)
    u = simulated.u.copy()
    u[:, 3] = rng.standard_normal(len(u)) * u[:, 3].std()
    found = outcome(simulated, simulated.write(tmp_path / "log.csv", u=u))
    assert found.joints[3].held_out > 0.5 and found.explains != "yes"
    assert simulated.joints[3] in found.verdict
    gain = found.of("motor gain")[3]
    assert gain.status != "identified" and gain.high / gain.low > 10


def test_a_validation_log_is_predicted_and_stated(simulated, tmp_path):
    path = simulated.write(tmp_path / "log.csv")
    lines = path.read_text().splitlines()
    first, last = tmp_path / "first.csv", tmp_path / "last.csv"
    first.write_text("\n".join(lines[:6000]) + "\n")
    last.write_text("\n".join([lines[0], *lines[6000:]]) + "\n")
    found = outcome(simulated, first, validate=last, columns=["viscous"], delay=0.016)
    assert "on the validation log" in found.verdict
    for joint in found.joints:
        assert joint.validation is not None and joint.validation < 0.2
