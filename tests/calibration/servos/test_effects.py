"""Effects beyond a servo's equation are told where they are, and nowhere else."""

import numpy as np
import pytest

from nsaid_mj.calibration.servos import identify_servos, servo_logs

from .simulated import KP, MODEL, F, log, write

JOINT, NAME = 2, "elbow_flex"


def stribeck(mj, data):
    """At rest friction is larger by 15 mrad of the servo's error."""
    fall = np.exp(-((data.qvel[JOINT] / 0.1) ** 2))
    mj.dof_frictionloss[JOINT] = KP[JOINT] * (F[JOINT] + 0.015 * fall)


def load(mj, data):
    """Friction grows by .3 of the weight."""
    mj.dof_frictionloss[JOINT] = KP[JOINT] * F[JOINT] + 0.3 * abs(data.qfrc_bias[JOINT])


EFFECTS = {"stribeck": (stribeck, 0.015), "load": (load, 0.3)}


def told(folder, change):
    """Sizes of the effects that are told, by joint and effect."""
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


def test_a_servo_that_obeys_its_equation_has_none(tmp_path):
    assert not told(tmp_path, None)
