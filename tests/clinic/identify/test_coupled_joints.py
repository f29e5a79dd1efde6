"""Joints that follow others, by an equality or <mimic>, are one coordinate with these."""

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
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


def test_laws_that_follow_a_log_know_no_coupled_joints(tmp_path):
    drawn = draw_coupled(1, tmp_path, duration=5.0)
    with pytest.raises(InvalidInput, match="--lock wrist"):
        identify(str(drawn.model), drawn.logs, law="efficient")
