"""Loads a tree of joints from a URDF or MJCF file, or by name; the only entry point."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from ..base import Finding
from .errors import BadRobot
from .files import REMEDY, robot_file
from .model import RobotModel
from .xml import check_named_files, read_xml

Base = Literal["held", "free"]
"""Whether a floating base is fixed to a stand or free."""


def load_robot(name: str, base: Base = "held") -> RobotModel:
    """Reads a robot to simulate; errors in its file are raised, not corrected.

    Joints that follow others (`<mimic>`) get coordinates of their own, and a warning.

    Args:
        name: a robot, packed or of example-robot-data, or the path of a URDF or MJCF file.
        base: whether a floating base is held or free. With `free`, a URDF file's root floats.

    Raises:
        MissingPackage: Pinocchio is not installed.
        UnknownName: there is no robot of this name; near matches are listed.
        BadRobot: it cannot be read, has a joint of several degrees of freedom or a link of
            physically impossible inertia, or its base cannot float.
    """
    file = robot_file(name)
    if base == "free" and file.named and not file.floats:
        raise BadRobot(name, "", "its base is fixed", "Use ArmPlant, or a robot that floats.")
    found = _read(file.path, (), None, base)
    return replace(found, name=name, source=None if file.named else found.source)


def load_tree(
    name: str,
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    others: Sequence[str] = (),
    floating: bool = False,
) -> RobotModel:
    """Reads a robot to identify: unphysical inertias are moved inside the cone, and reported.

    Args:
        name: a robot, packed or of example-robot-data, or the path of a URDF or MJCF file.
        lock: joints to fix, at 0 or at the nearest limit.
        joints: joints to keep; None keeps all that are not in `lock`.
        others: further names to suggest.
        floating: whether its base floats, as a walking robot's does; else it is held.

    Raises:
        BadRobot: the file cannot be read, or describes a robot that is not a tree of revolute and
            prismatic joints, or whose base cannot float.
        InvalidInput: a joint is to be both locked and kept.
        UnknownName: there is no such robot or joint; the message lists similar names.
    """
    file = robot_file(name, others)
    found = _read(file.path, lock, joints, None, floating)
    if not file.named:
        return found
    findings = found.findings
    if file.floats and not floating:
        text = "its base can move; it was taken as fixed to a stand, level"
        remedy = "Use logs of the robot on a stand, or log its IMU, too."
        findings += (Finding("warning", "base_held", name, text, remedy),)
    return replace(found, name=name, source=None, findings=findings)


def _read(
    path: Path,
    lock: Sequence[str],
    joints: Sequence[str] | None,
    base: Base | None = None,
    floating: bool = False,
) -> RobotModel:
    """Reads a file by its content: a URDF may be called .xml. `base` is None to identify."""
    if path.suffix.lower() == ".xacro":
        remedy = f"Convert it first: `xacro {path.name} > {path.stem}.urdf`."
        raise BadRobot(str(path), "", "it is a xacro template, not a URDF", remedy)
    compiled = path.suffix.lower() == ".mjb"
    root = None
    encoding: Sequence[Finding] = ()
    if not compiled:
        root, encoding = read_xml(path)
    if root is None or root.tag == "mujoco":
        from .mjcf import load_mjcf

        return load_mjcf(path, lock, joints, base, floating or base == "free")
    if root.tag == "robot":
        check_named_files(path)
        from .urdf import load_urdf

        return load_urdf(path, root, encoding, lock, joints, base, floating or base == "free")
    reason = f"its root element is <{root.tag}>, neither <robot> nor <mujoco>"
    raise BadRobot(str(path), "", reason, REMEDY)
