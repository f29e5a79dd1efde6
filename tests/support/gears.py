"""An arm in MuJoCo whose gears twist or have play, which its model file does not say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

JOINTS = ("shoulder", "elbow")
GAIN = (12.0, 5.0)  # N·m/A
STEP, EVERY = 5e-4, 8  # s; steps per row of the log


class Gear(NamedTuple):
    """The gear of one joint.

    Attributes:
        stiffness: of its twist [N·m/rad]; inf for a rigid one.
        play: between its flanks [rad].
        load_side: whether the encoder is on the link's side.
    """

    stiffness: float = np.inf
    play: float = 0.0
    load_side: bool = False


RIGID = (Gear(), Gear())


def mjcf(gears: Sequence[Gear] = RIGID, spring: float = 0.0, rest: float = 0.0) -> str:
    """The arm's MJCF; without arguments that of its maker.

    Args:
        gears: of both joints.
        spring: that pulls at the shoulder [N·m/rad].
        rest: where it does not [rad].
    """
    body = ""
    for name, gear, mass in reversed(list(zip(JOINTS, gears, (4.0, 2.0), strict=True))):
        own = f'<inertial pos="0 0 -.2" mass="{mass}" diaginertia="{mass / 50} {mass / 50} .005"/>'
        pull = f'stiffness="{spring}" springref="{rest}"' if name == "shoulder" else ""
        motor = f'<joint name="{name}" axis="0 1 0" armature=".3" damping="1" {pull}/>'
        if gear.stiffness < np.inf or gear.play:
            motor += '<inertial pos="0 0 0" mass="1e-3" diaginertia="1e-6 1e-6 1e-6"/>'
            damping = 0.02 if gear.play else 0.3
            twist = f'<joint name="{name} gear" axis="0 1 0" damping="{damping}" '
            if gear.play:
                twist += f'range="{-gear.play / 2} {gear.play / 2}" solreflimit="-4e5 -1200"/>'
            else:
                twist += f'stiffness="{gear.stiffness}"/>'
            link = f'<body name="{name} link">{twist}{own}{body}</body>'
        else:
            link = own + body
        place = -0.4 if name == "elbow" else 0
        body = f'<body name="{name} body" pos="0 0 {place}">{motor}{link}</body>'
    motors = "".join(f'<motor joint="{n}" gear="{g}"/>' for n, g in zip(JOINTS, GAIN, strict=True))
    return (
        f'<mujoco model="arm"><compiler angle="radian"/><option timestep="{STEP}" '
        f'integrator="implicitfast"/><worldbody>{body}</worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )


@cache
def log(
    text: str,
    gears: tuple[Gear, ...],
    seed: int,
    drag: Callable[[np.ndarray, mujoco.MjData], np.ndarray] | None = None,
    seconds: float = 20.0,
) -> dict[str, np.ndarray]:
    """Columns of a log: positions and currents of both joints under a controller of their motion.

    Args:
        text: the arm's MJCF.
        gears: whose encoders are read.
        seed: of motion and noise.
        drag: torques (2,) on the motors by their velocities, beyond those of the model.
        seconds: of motion.
    """
    rng = np.random.default_rng([seed, 33])
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    motors = [model.joint(name).id for name in JOINTS]
    rates = 2 * np.pi * rng.uniform(0.1, 1.2, (6, 2))
    sizes, phases = rng.uniform(0.3, 1.0, (6, 2)) / rates, rng.uniform(0, 6.28, (6, 2))
    sizes *= 1.5 / np.sqrt(np.sum((sizes * rates) ** 2, axis=0))
    times = STEP * np.arange(round(seconds / STEP))
    angles = np.multiply.outer(times, rates) + phases
    aims = np.sum(sizes * (np.sin(angles) - np.sin(phases)), axis=1)
    speeds = np.sum(sizes * rates * np.cos(angles), axis=1) * np.minimum(1.0, times)[:, None]
    stiffness, damping = np.array([400, 150]) / GAIN, np.array([40, 15]) / GAIN
    rows = []
    for k, (aim, speed) in enumerate(zip(aims, speeds, strict=True)):
        q, v = data.qpos[motors], data.qvel[motors]
        data.ctrl[:] = stiffness * (aim - q) + damping * (speed - v)
        if k % EVERY == 0:
            twist = [
                data.joint(f"{n} gear").qpos[0] if g.load_side else 0.0
                for n, g in zip(JOINTS, gears, strict=True)
            ]
            rows.append([data.time, *(q + twist), *data.ctrl])
        if drag is not None:
            data.qfrc_applied[motors] = -drag(v, data)
        mujoco.mj_step(model, data)
    found = np.array(rows)
    found[:, 1:3] += 2e-5 * rng.standard_normal(found[:, 1:3].shape)
    found[:, 3:] *= 1 + 0.003 * rng.standard_normal(found[:, 3:].shape)
    names = ["time", *(f"{n}_position" for n in JOINTS), *(f"{n}_current" for n in JOINTS)]
    return dict(zip(names, found.T, strict=True))


def written(folder: Path) -> Path:
    """The maker's MJCF in a folder."""
    path = folder / "arm.xml"
    path.write_text(mjcf(), encoding="utf-8")
    return path
