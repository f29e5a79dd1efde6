"""Identified values as files: the format is that of the file's name."""

from __future__ import annotations

from pathlib import Path

from .identified import Identified
from .mjcf_export import write_mjcf
from .model import RobotModel
from .tables import write_sysid
from .urdf import write_urdf

_WRITERS = {".urdf": write_urdf, ".xml": write_mjcf, ".yaml": write_sysid}


def write_model(robot: RobotModel, values: Identified, path: Path) -> None:
    """Writes identified values: .urdf and .xml (MJCF) are models, .yaml is for `mujoco.sysid`.

    Raises:
        InvalidInput: the robot is a vehicle, or was not read from a URDF that is asked for.
    """
    _WRITERS[path.suffix](robot, values, path)
