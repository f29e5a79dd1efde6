"""Legs of a robot on a stand: each has a scale of its own, which no motion reveals."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.links import file_links, sizes_of_links, weight_columns
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.result import Identification
from tests.support.robot_logs import TWO_LEGS, write_csv


def logged(folder: Path, seed: int) -> tuple[Path, Path, np.ndarray]:
    """The model file, a log of other legs of its kind, and their true gains (6,).

    MuJoCo's friction creeps by default, which no column explains.
    """
    (model := folder / "biped.xml").write_text(TWO_LEGS, encoding="utf-8")
    m, rng = mujoco.MjModel.from_xml_string(TWO_LEGS), np.random.default_rng(seed)
    share = 1 + 0.2 * rng.uniform(-1, 1, m.nbody)
    m.body_mass[:] *= share
    m.body_inertia[:] *= share[:, None]
    gain = np.exp(rng.uniform(-0.14, 0.14, m.nu))
    m.actuator_gainprm[:, 0] *= gain
    d, rows, n = mujoco.MjData(m), [], m.nv
    w, size = 2 * np.pi * 0.45 * np.arange(1, 5), rng.normal(size=(n, 4)) / np.arange(1, 5)
    phase = rng.uniform(0, 2 * np.pi, (n, 4))
    for k in range(9_000):
        if k % 5 == 0:
            desired = 0.6 * (size * np.sin(w * 1e-3 * k + phase)).sum(axis=1)
            d.ctrl[:] = d.qfrc_bias + 60 * (desired - d.qpos) - 3 * d.qvel
            q, v = d.qpos + 1e-4 * rng.normal(size=n), d.qvel + 2e-3 * rng.normal(size=n)
            rows.append([1e-3 * k, *q, *v, *d.ctrl])
        mujoco.mj_step(m, d)
    names = [m.joint(j).name for j in range(n)]
    columns = ["t", *(f"{x}_{what}" for what in ("pos", "vel", "effort") for x in names)]
    values = dict(zip(columns, np.array(rows).T, strict=True))
    return model, write_csv(folder / "biped.csv", values), gain


@pytest.fixture(scope="module")
def biped(tmp_path_factory) -> tuple[Path, Path, np.ndarray]:
    return logged(tmp_path_factory.mktemp("biped"), 5)


@pytest.fixture(scope="module")
def identified(biped) -> tuple[Identification, np.ndarray]:
    model, log, gain = biped
    return identify_forces(str(model), [log]), gain


def test_gains_of_both_legs_are_covered(identified):
    """With one size for all, a leg whose shape the rows change drifted to a third of its scale."""
    result, truth = identified
    gains = [p for p in result.parameters if p.is_gain]
    assert [p.name for p, k in zip(gains, truth, strict=True) if not p.low <= k <= p.high] == []
    assert max(abs(np.log(p.value / k)) for p, k in zip(gains, truth, strict=True)) < 0.5
    assert "within each of the 2 limbs" in result.verdict


def with_head(folder: Path) -> Path:
    """The model file with a head that turns about a vertical axis."""
    pan = '<body><joint name="pan" axis="0 0 1"/><geom size=".1" mass="2"/></body></worldbody>'
    motor = '<motor joint="pan"/></actuator>'
    text = TWO_LEGS.replace("</worldbody>", pan).replace("</actuator>", motor)
    (path := folder / "head.xml").write_text(text, encoding="utf-8")
    return path


@pytest.mark.slow  # the size of such a limb is tested below
def test_the_gain_of_a_head_that_stands_still_is_a_wide_guess(biped, tmp_path):
    names, *rows = biped[1].read_text(encoding="utf-8").splitlines()
    values, rng = np.array([row.split(",") for row in rows], float), np.random.default_rng(0)
    still = rng.normal(size=(len(values), 3)) * [1e-4, 2e-3, 1e-3]
    columns = [*names.split(","), "pan_pos", "pan_vel", "pan_effort"]
    table = dict(zip(columns, np.hstack([values, still]).T, strict=True))
    found = identify_forces(str(with_head(tmp_path)), [write_csv(tmp_path / "log.csv", table)])
    gain = found.of("motor gain")[-1]
    assert gain.low < 1.0 < gain.high and gain.status != "identified"


def test_a_limb_that_stands_still_on_a_vertical_axis_has_its_mass_as_size(biped):
    """Neither weight nor inertia acts on its joint."""
    path = with_head(biped[0].parent)
    robot, rng = load_robot_model(str(path)), np.random.default_rng(0)
    model, system = robot.model, robot.system
    q, v, a = rng.uniform(-1, 1, (3, 50, 7)) * np.append(np.ones(6), 0.0)
    moving = system.regressor(0.0, np.hstack([q, v]), v, a, np.zeros(7)).reshape(-1, 70)
    sizes = sizes_of_links(model, moving, weight_columns(system, q))
    np.testing.assert_allclose(sizes @ file_links(model), 1.0, rtol=1e-9)
    assert sizes[2].nonzero()[0].tolist() == [60] and sizes[2, 60] == pytest.approx(0.5)


@pytest.mark.slow
def test_a_known_gain_says_nothing_of_the_other_leg(biped):
    model, log, gain = biped
    result = identify_forces(str(model), [log], known={"gain_1": float(gain[0])})
    (told,) = (f for f in result.findings if f.code == "known_in_combination")
    assert "not at all to those of other limbs" in told.text
    assert "give the gain of right_" in told.remedy  # a motor of the other leg
