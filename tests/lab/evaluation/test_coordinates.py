"""θ̄ of a run in the paper's coordinates."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import theta_bar
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.loop import run
from tests.support.faulty import ROV


def test_both_parts_make_the_estimate_and_the_second_is_what_the_summary_judges(tmp_path: Path):
    done = run(replace(ROV, duration=2.0), tmp_path)
    postprocessing.finish(done)
    bar = theta_bar(tmp_path)
    scaled = done.record["theta_hat"] / done.system.space.scale
    Q = Truth.of(done).nullspace.Q
    assert bar.P.shape[1] == done.record.metadata["r"] == 1
    np.testing.assert_allclose(np.hstack([bar.P, bar.perp]) @ Q.T, scaled, atol=1e-12)
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    for row, key in [(0, "theta_perp_ratio_initial"), (-1, "theta_perp_ratio")]:
        ratio = np.linalg.norm(bar.perp[row]) / np.linalg.norm(scaled[row])
        assert ratio == pytest.approx(summary[key])
