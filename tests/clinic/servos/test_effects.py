"""Effects beyond a servo's equation are told where they are, and nowhere else."""

import numpy as np
import pytest

from nsaid_mj.clinic.servos.estimate import _reveals
from nsaid_mj.clinic.servos.fit import GRAVITY, JointFit, ServoPrior, minimise, spreads
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.clinic.servos.simulation import JointLog, simulate

from .simulated import KP, MODEL, F, log, write

JOINT, NAME = 2, "elbow_flex"


def stribeck(mj, data):
    """At rest friction is larger by 15 mrad of the servo's error."""
    fall = np.exp(-((data.qvel[JOINT] / 0.1) ** 2))
    mj.dof_frictionloss[JOINT] = KP[JOINT] * (F[JOINT] + 0.015 * fall)


def load(mj, data):
    """Friction grows by .3 of the weight."""
    mj.dof_frictionloss[JOINT] = KP[JOINT] * F[JOINT] + 0.3 * abs(data.qfrc_bias[JOINT])


pytestmark = pytest.mark.usefixtures("no_profile_search")
EFFECTS = {"stribeck": (stribeck, 0.015), "load": (load, 0.3)}


def told(folder, change):
    """Sizes of the effects that are told, by joint and effect; `test_recovery.py` has none."""
    files = [
        write(folder / f"motion_{k}.csv", *log(40 + k, seconds=30.0, change=change))
        for k in range(2)
    ]
    given = servo_logs(MODEL, files)
    assert given is not None
    found = identify_servos(given).findings
    return {
        (f.where, f.data["effect"]): f.data["size"]
        for f in found
        if f.code == "beyond_the_equation"
    }


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_is_told_with_its_size(tmp_path, effect):
    change, size = EFFECTS[effect]
    found = told(tmp_path, change)
    assert {joint for joint, _ in found} == {NAME}, found
    assert found[NAME, effect] == pytest.approx(size, rel=0.35), found


@pytest.mark.parametrize(("weight", "play"), [(0.03, 0.0), (0.03, 0.02), (1.0, 0.01)])
def test_play_does_not_make_a_light_joint_s_kp_sure_and_wrong(weight, play):
    """A joint sinks by its gear's play to the side of its load, as if its servo were softer."""
    rng, t = np.random.default_rng(0), np.arange(0.0, 60.0, 0.02)
    target = np.interp(t, np.arange(61.0), rng.uniform(-1.0, 1.0, 61))
    load, theta = weight * np.sin(2 * target), np.array([0.06, 0.012, 1 / 9, 9e-4, 0.015])
    log = JointLog(t, target, np.zeros(len(t)), load, np.full(len(t), 1e-4))
    position = simulate(log, theta) - 0.5 * play * np.tanh(load / 0.01)
    position = np.round((position + 3e-4 * rng.standard_normal(len(t))) / 1.5e-3) * 1.5e-3
    own = JointFit([log._replace(position=position)], np.ones(len(t)))
    prior = ServoPrior(np.log(theta), np.array([3.0, 3.0, 3.0, 1.0, 1.5]))
    fit, cluster = minimise(own, np.log(theta), prior), (t // 10).astype(int)
    (found,) = spreads([fit], cluster, [np.array([2e-3])])
    off = abs(fit.x[GRAVITY] - np.log(theta[GRAVITY]))
    sure = _reveals(found.covariance[GRAVITY, GRAVITY], found.moved[GRAVITY, 1])
    assert sure == (weight == 1.0)
    assert off < 0.1 if sure or not play else off > 0.5
