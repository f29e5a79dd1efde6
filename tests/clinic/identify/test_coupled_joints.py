"""Joints that follow others, by an equality or <mimic>, are one coordinate with these."""

import mujoco
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.export import write_models
from nsaid_mj.clinic.identify.identify import identify
from tests.court.field_commands import draw_coupled


@pytest.mark.parametrize("urdf", [False, True])
def test_gains_and_friction_of_coupled_joints_are_found(tmp_path, urdf):
    drawn = draw_coupled(1, tmp_path, duration=15.0, urdf=urdf)
    found = identify(str(drawn.model), drawn.logs)
    own = {p.label: p for p in found.parameters}
    assert all(own[label].low <= true <= own[label].high for label, true in drawn.truth.items())
    ratio = own["gain of shoulder"].value / own["gain of elbow"].value
    true = drawn.truth["gain of shoulder"] / drawn.truth["gain of elbow"]
    assert ratio == pytest.approx(true, rel=0.02)
    assert max(j.held_out for j in found.joints[:2]) < 0.03 and np.isnan(found.joints[2].held_out)
    assert not [p for p in own if p.endswith("of wrist")]
    replayed = write_models(found, tmp_path)[1][0]
    assert "wrist" not in replayed.text and replayed.level == "note"
    assert_follows(tmp_path / f"{found.robot.name}.xml", found.robot.coupling)
    shown = [f.text for f in found.findings if f.code in ("rest_limits", "delay")]
    assert not any("wrist" in text for text in shown)


def assert_follows(file, coupling):
    """The exported model's joints keep to the coupling while its motors turn."""
    mj = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(mj)
    data.qpos[:] = coupling.offset
    mujoco.mj_forward(mj, data)
    for _ in range(400):
        data.ctrl[:] = 5 * np.sin(10 * data.time + np.arange(mj.nu))
        mujoco.mj_step(mj, data)
    leading = data.qpos[list(coupling.leaders)]
    assert np.abs(leading).max() > 0.05
    np.testing.assert_allclose(data.qpos, coupling.ratio @ leading + coupling.offset, atol=5e-3)


def test_laws_that_follow_a_log_know_no_coupled_joints(tmp_path):
    drawn = draw_coupled(1, tmp_path, duration=5.0)
    with pytest.raises(InvalidInput, match="--lock wrist"):
        identify(str(drawn.model), drawn.logs, law="efficient")
