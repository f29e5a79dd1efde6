"""Models are judged open loop over three horizons; what is better scores better."""

import json

import mujoco.sysid
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, NoEstimate
from nsaid_mj.cli.commands import command
from nsaid_mj.clinic.identify.comparison import IDENTIFIED, STOCK, SYSID, compare_servos
from nsaid_mj.clinic.servos.estimate import DELAYS, late
from nsaid_mj.clinic.servos.export import rollout
from nsaid_mj.clinic.servos.identify import servo_logs
from nsaid_mj.robots.errors import BadRobot

from .simulated import ARMATURE, DELAY, JOINTS, KP, MODEL, F, T, log, write


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two logs, the true arm as a file, and one whose damping is thrice the true one."""
    found = tmp_path_factory.mktemp("models")
    for k in range(2):
        write(found / f"log_{k}.csv", *log(40 + k, 16.0))
    for name, factor in (("true", 1.0), ("damped", 3.0)):
        text = MODEL.read_text()
        for k, joint in enumerate(JOINTS):
            own = f'damping="0" armature="{ARMATURE}" frictionloss="{KP[k] * F[k]}"'
            own += ' solimpfriction="0.9999 0.9999 0.001 0.5 2" solreffriction="0.001 1"'
            text = text.replace(
                f'name="{joint}" type="hinge"', f'name="{joint}" type="hinge" {own}'
            )
            servo = f'kp="{KP[k]}" kv="{factor * KP[k] * T[k]}" forcelimited="false"'
            servo += f' delay="{DELAY}" nsample="20"'
            text = text.replace(f'name="{joint}" joint=', f'{servo} name="{joint}" joint=')
        text = text.replace("<worldbody>", '<option timestep="0.001"/><worldbody>', 1)
        text = text.replace('forcerange="-3.35 3.35"', "")
        (found / f"{name}.xml").write_text(text)
    return found


@pytest.fixture(scope="module")
def given(folder):
    found = servo_logs(MODEL, sorted(folder.glob("*.csv")))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def scores(folder, given):
    with pytest.MonkeyPatch.context() as patch:  # as `no_profile_search`, for a module
        nothing = np.zeros(3), ()
        patch.setattr("nsaid_mj.clinic.servos.identify.hidden_profile", lambda logs: nothing)
        return compare_servos(given, [folder / "true.xml", folder / "damped.xml", IDENTIFIED])


def test_the_true_model_is_the_best_and_the_identified_one_is_near(scores):
    true, damped, identified, target = (1e3 * s.errors.mean(axis=1) for s in scores)
    assert (true < 1.0).all()
    assert (damped[1:] > 5 * true[1:]).all()
    assert identified[-1] < 2.0 < damped[-1]
    assert target[-1] > 5 * identified[-1] and np.isnan(target[:2]).all()
    assert scores[0].one_step.mean() < 0.5


@pytest.mark.skipif(not hasattr(mujoco.sysid, "optimize"), reason="needs mujoco[sysid]")
def test_mujocos_toolbox_predicts_better_than_the_file_it_starts_from(folder):
    given = servo_logs(folder / "damped.xml", sorted(folder.glob("*.csv")))
    assert given is not None
    short = given._replace(logs=tuple(one.part(slice(0, 150)) for one in given.logs))
    damped, best, _ = compare_servos(short, [folder / "damped.xml", SYSID])
    assert best.errors[-1].mean() < 0.3 * damped.errors[-1].mean()


def test_the_toolbox_without_its_dependencies_says_how_to_install_them(given, folder, monkeypatch):
    monkeypatch.delattr(mujoco.sysid, "optimize", raising=False)
    with pytest.raises(NoEstimate, match=r"mujoco\[sysid\]"):
        compare_servos(given, [folder / "true.xml", STOCK])


def test_a_simulation_that_starts_again_departs_less(scores):
    _, damped, *_ = scores
    assert (np.diff(damped.errors.mean(axis=1)) > 0).all()


def test_a_horizon_of_nought_predicts_every_row_from_the_one_before(folder, given):
    """What was simulated earlier does not matter, but for targets that are still on their way."""
    one, path, k = given.logs[0], folder / "damped.xml", 200
    names = ("t", "target", "position", "load", "mass")
    part = one._replace(**{name: getattr(one, name)[k:300] for name in names})
    whole, rest = (rollout(path, JOINTS, log, horizon=0.0) for log in (one, part))
    np.testing.assert_allclose(rest[3:-1], whole[k + 3 : 299], atol=1e-4)
    free = rollout(path, JOINTS, part)
    assert np.abs(free - part.position).mean() > 5 * np.abs(rest - part.position).mean()


def test_the_late_target_is_the_best_of_all_delays(scores, given):
    used = np.ones(sum(len(one.t) for one in given.logs))
    for j in range(len(JOINTS)):
        joint = [one.joint(j) for one in given.logs]
        assert scores[-1].errors[-1, j] <= min(late(joint, used, d) for d in DELAYS[::3]) + 1e-12


def test_the_command_prints_every_joint_as_json(folder, capsys):
    logs = [str(p) for p in sorted(folder.glob("*.csv"))]
    models = [str(folder / "true.xml")]
    assert command(["compare", "--log", *logs, "--models", *models, "--json"]) == 0
    first, target = json.loads(capsys.readouterr().out)
    assert set(first["mae_2_s"]) == set(JOINTS) and target["mae_2_s"]["gripper"] is None
    assert target["mae_whole_log"]["elbow_flex"] > first["mae_whole_log"]["elbow_flex"]
    assert command(["compare", "--log", *logs, "--models", *models]) == 0
    assert "the target, late" in capsys.readouterr().out


def test_what_cannot_be_compared_is_refused(folder, given, tmp_path):
    other = tmp_path / "other.xml"
    other.write_text(
        (folder / "true.xml")
        .read_text()
        .replace('"gripper" type', '"jaw" type')
        .replace('joint="gripper"', 'joint="jaw"')
    )
    with pytest.raises(BadRobot, match="gripper"):
        compare_servos(given, [other])
    for arguments in (["--log", "a.csv"], ["--models", "identified"]):
        with pytest.raises(InvalidInput, match="--models"):
            command(["compare", *arguments])
    with pytest.raises(BadRobot, match=r"none\.xml: no such file"):
        command(["compare", "--models", "none.xml", "--log", "a.csv"])
