"""Actuators of an MJCF file: what a command means, and how large it may be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ..parameters import Array
from .findings import Finding, Level
from .mjcf_tree import actuators_of


class Motors(NamedTuple):
    """The motors of some joints.

    Attributes:
        joints: (k,) their names.
        gain: (k,) force per unit of command [N·m or N].
        limits: (k,) largest absolute commands; inf where there is none.
        damping: (k,) damping of the actuators [N·m·s/rad or N·s/m].
        findings: what a command means.
        passive: names of the joints without an actuator in a file that has some.
    """

    joints: tuple[str, ...]
    gain: Array
    limits: Array
    damping: Array
    findings: list[Finding]
    passive: tuple[str, ...]


def motors(mj: Any, names: Sequence[str], joints: tuple[str, ...]) -> Motors:
    """The motors of a MuJoCo model.

    The command of a motor is its `ctrl`, and its gain is gear · gainprm. A joint with a servo, or
    without any actuator, has commands in N·m or N and gain 1.

    Args:
        mj: MuJoCo's model.
        names: of all its joints.
        joints: (k,) names of the joints to look at.
    """
    gain, limits, damping = (
        np.ones(len(joints)),
        np.full(len(joints), np.inf),
        np.zeros(len(joints)),
    )
    servos, bare, lagging, several = [], [], [], []
    for k, joint in enumerate(joints):
        j = names.index(joint)
        actuators = actuators_of(mj, j)
        if not actuators:
            bare.append(joint)
            continue
        i, gear = actuators[0], mj.actuator_gear[actuators[0], 0]
        damping[k] = sum(mj.actuator_damping[a] * mj.actuator_gear[a, 0] ** 2 for a in actuators)
        if len(actuators) > 1:
            several.append(joint)
        if mj.actuator_dyntype[i] != mujoco.mjtDyn.mjDYN_NONE:
            lagging.append(joint)
        if is_motor(mj, i):
            gain[k] = gear * mj.actuator_gainprm[i, 0]
        else:
            servos.append(joint)
        limits[k] = _limit(mj, i, j, gear, float(gain[k]))
    told: tuple[tuple[str, Level, list[str], str], ...] = (
        ("no_actuator", "note", bare, "no actuator in the file; u must be the joint's force"),
        ("servo", "warning", servos, "position or velocity servos in the file; u must be the "
         "joint's force or motor current, not the setpoint"),
        ("actuator_lag", "note", lagging, "actuators with an activation; the lag was left out"),
        ("several_actuators", "warning", several, "several actuators; u is taken as the first's"),
    )  # fmt: skip
    findings = [
        Finding(level, code, ", ".join(where), text, data={"joints": where})
        for code, level, where, text in told
        if where
    ]
    driven = [joint for joint in joints if joint not in {*servos, *bare}]
    if driven:
        text = "u is the motor's ctrl; the file's gains are " + ", ".join(
            f"{gain[joints.index(joint)]:g}" for joint in driven
        )
        findings.append(Finding("note", "command", ", ".join(driven), text))
    return Motors(joints, gain, limits, damping, findings, tuple(bare) if mj.nu else ())


def is_motor(mj: Any, actuator: int) -> bool:
    """Whether an actuator's force is a constant gain times its command or activation."""
    return bool(
        mj.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and mj.actuator_gainprm[actuator, 0] != 0
        and mj.actuator_gear[actuator, 0] != 0
        and (
            mj.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
            or not mj.actuator_biasprm[actuator].any()
        )
    )


def _limit(mj: Any, actuator: int, joint: int, gear: float, gain: float) -> float:
    """The largest absolute command of an actuator; inf if there is none."""
    found = [np.inf]
    if mj.actuator_ctrllimited[actuator] and is_motor(mj, actuator):
        found.append(np.abs(mj.actuator_ctrlrange[actuator]).max())
    if mj.actuator_forcelimited[actuator]:
        found.append(abs(gear / gain) * np.abs(mj.actuator_forcerange[actuator]).max())
    if mj.jnt_actfrclimited[joint]:
        found.append(np.abs(mj.jnt_actfrcrange[joint]).max() / abs(gain))
    return float(min(found))
