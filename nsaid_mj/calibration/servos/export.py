"""The user's own MJCF with identified servos, and its open-loop simulation."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from ...errors import BadRobot
from ...parameters import Array
from ...plants.world.coordinates import JointMap
from ...resources import write_text
from ..models.mjcf_file import compile_file
from ..models.mjcf_tree import actuators_of, joint_names
from ..models.mjcf_xml import numbers
from .logs import ServoLog
from .result import Servo, ServoIdentification

_HARD = "0.9999 0.9999 0.001 0.5 2"
# solimpfriction: MuJoCo's default is so soft that a joint creeps under its load instead of sticking
_REMARK = """ Servos identified by nsaid from logs of targets and positions.
{verdict}
kp, kv, armature and frictionloss are identified; damping is part of kv; forcerange is removed, for
no saturation was seen. The target's delay is the actuator's own attribute (MuJoCo 4): do not delay
targets a second time, and fill its buffer with the first target (mj_initCtrlHistory). Biases: 0.
{joints} """


def write_servo_mjcf(result: ServoIdentification, path: Path) -> None:
    """Writes the model's own MJCF with the servos of a result; nothing else is changed.

    Raises:
        BadRobot: the joints or actuators are not in the file itself but in one that it includes.
    """
    source = result.robot.source
    assert source is not None  # a model with servos comes from a file
    builder = ElementTree.TreeBuilder(insert_comments=True)
    root = ElementTree.parse(source, ElementTree.XMLParser(target=builder)).getroot()
    mj = compile_file(source)[1]
    names = joint_names(mj)
    joints = {e.get("name"): e for body in root.findall("worldbody") for e in body.iter("joint")}
    actuators = [e for section in root.findall("actuator") for e in section if e.tag != "!"]
    actuators = [e for e in actuators if isinstance(e.tag, str)]
    for servo in result.servos:
        index = actuators_of(mj, names.index(servo.name))[0]
        if servo.name not in joints or len(actuators) != mj.nu:
            remedy = "Merge the included files into one (MuJoCo's `compile` does it)."
            raise BadRobot(str(source), servo.name, "it is not in the file itself", remedy)
        joint = joints[servo.name]
        joint.attrib |= {
            "armature": numbers(servo.armature),
            "damping": "0",
            "frictionloss": numbers(servo.friction),
            "solimpfriction": _HARD,
        }
        _set_actuator(actuators[index], servo, float(mj.opt.timestep))
    for compiler in root.findall("compiler"):
        _redirect(compiler, source.resolve().parent, path.resolve().parent)
    told = "\n".join(
        f"{s.name}: delay {s.delay * 1e3:.1f} ms, kp "
        + ("told by gravity" if s.gravity else "a convention")
        for s in result.servos
    )
    remark = _REMARK.format(verdict=result.verdict, joints=told).replace("--", "- -")
    root.insert(0, ElementTree.Comment(remark))
    write_text(path, ElementTree.tostring(root, encoding="unicode") + "\n")


def _set_actuator(element: Element, servo: Servo, timestep: float) -> None:
    """Gives an actuator its gains and its delay."""
    for key in ("dampratio", "timeconst", "forcerange", "damping", "armature"):
        element.attrib.pop(key, None)
    element.set("forcelimited", "false")
    if element.tag == "position":
        element.attrib |= {"kp": numbers(servo.kp), "kv": numbers(servo.kv)}
    else:
        element.set("gainprm", numbers(servo.kp))
        element.set("biasprm", numbers([0.0, -servo.kp, -servo.kv]))
    element.set("delay", numbers(servo.delay))
    element.set("nsample", str(math.ceil(1.2 * servo.delay / timestep) + 2))


def _redirect(compiler: Element, old: Path, new: Path) -> None:
    """Makes the folders of meshes and textures relative to the new file's folder."""
    for directory in ("meshdir", "texturedir"):
        inside = compiler.get(directory, compiler.get("assetdir", ""))
        compiler.set(directory, Path(os.path.relpath(old / inside, new)).as_posix())


def rollout(path: Path, joints: Sequence[str], log: ServoLog) -> Array:
    """(N, n) positions of an MJCF driven open loop by a log's targets, in full MuJoCo.

    It starts at rest at the first position; contacts are off. Steps are those of the file, or a
    little shorter, so that they end at the log's times.
    """
    mj: Any = compile_file(path)[1]
    mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data, where, names = mujoco.MjData(mj), JointMap(mj, joints), joint_names(mj)
    servos = [actuators_of(mj, names.index(joint))[0] for joint in joints]
    where.write(data, log.position[0], np.zeros(len(joints)))
    for u, i in zip(log.target[0], servos, strict=True):
        if mj.actuator_history[i, 0]:
            mujoco.mj_initCtrlHistory(mj, data, i, None, np.full(mj.actuator_history[i, 0], u))
    longest, out = mj.opt.timestep, np.empty_like(log.position)
    out[0] = log.position[0]
    for k, interval in enumerate(np.diff(log.t)):
        steps = math.ceil(interval / longest - 1e-3)
        mj.opt.timestep = interval / steps
        data.ctrl[servos] = log.target[k]
        mujoco.mj_step(mj, data, steps)
        out[k + 1] = where.read(data)[0]
    return out
