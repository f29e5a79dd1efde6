"""The verdict is that of motion left out of the fit, in MuJoCo as the user will run the file."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.servos.export import replayed, stiff_notes, write_servo_mjcf
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.clinic.servos.logs import ServoLogs
from nsaid_mj.clinic.servos.result import ServoIdentification, concluded, verdict
from tests.clinic.servos.simulated import MODEL, log, write
from tests.clinic.servos.test_words import joint


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> tuple[ServoIdentification, ServoLogs]:
    folder = tmp_path_factory.mktemp("unseen")
    given = servo_logs(MODEL, [write(folder / "log.csv", *log(0, 20.0))])
    assert given is not None
    with pytest.MonkeyPatch.context() as patch:  # no profile is sought, which takes long
        nothing = np.zeros(3), ()
        patch.setattr("nsaid_mj.clinic.servos.identify.hidden_profile", lambda _: nothing)
        return identify_servos(given), given


def test_an_error_of_three_quarters_of_a_simple_predictions_does_not_explain():
    assert verdict([joint(error=77.8e-3, simple=101.7e-3)])[0] == "partly"
    assert verdict([joint(error=20e-3, simple=101.7e-3)])[0] == "yes"
    few = joint(error=1.2e-3, simple=2e-3)._replace(zero=1e-3)  # three steps of the encoder
    assert verdict([few])[0] == "yes"


def test_the_headline_is_of_unseen_motion(found, tmp_path):
    result, given = found
    path = tmp_path / "arm.xml"
    write_servo_mjcf(result, path)
    judged, _ = replayed(result, path, given)
    assert "left out of the fit" in judged.verdict and judged.explains == "yes"
    assert len(result.left_out) == 2
    (whole,) = {s.kp for s in result.servos[:1]}
    assert all(part.servos[0].kp != whole for part in result.left_out)


def test_what_diverges_never_explains(found):
    result, _ = found
    fine = np.array([joint.error for joint in result.joints])
    assert concluded(result, fine, "a motion", fine).explains == "yes"
    for error in (np.full(len(fine), 632.0), np.full(len(fine), np.nan)):
        judged = concluded(result, fine, "a motion", error)
        assert judged.explains == "no" and "diverges" in judged.verdict


def test_damping_that_is_too_large_for_an_explicit_step_changes_the_integrator(found, tmp_path):
    result, given = found
    assert not stiff_notes(result)
    stiff = tuple(replace(s, kv=1.0, armature=1e-6, kp=15.0) for s in result.servos)
    other = replace(result, servos=stiff)
    path = tmp_path / "arm.xml"
    write_servo_mjcf(other, path)
    mj = mujoco.MjModel.from_xml_path(str(path))
    (note,) = stiff_notes(other)
    assert mj.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST and "2:" in note.text
    judged, replay = replayed(other, path, given)
    assert np.isfinite(np.concatenate(replay.simulated)).all() and "diverges" not in judged.verdict
