"""Checks the numbers of a compiled MJCF: MuJoCo accepts some that are infinite or NaN."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..bounds import LARGEST
from ..errors import BadRobot
from .tree import body_name

_NUMBERS = {
    "body": ("mass", "inertia", "ipos", "iquat", "pos", "quat"),
    "jnt": ("pos", "axis", "stiffness"),
    "dof": ("damping", "frictionloss", "armature"),
    "actuator": ("gear", "gainprm", "biasprm", "damping", "armature"),
}
_RANGES = {"jnt": ("range", "actfrcrange"), "actuator": ("ctrlrange", "forcerange")}
_WORDS = {
    "ipos": "centre of mass",
    "iquat": "orientation of its inertia",
    "pos": "place",
    "quat": "orientation",
    "frictionloss": "friction",
    "gainprm": "gain",
    "biasprm": "bias",
    "actfrcrange": "range of forces",
    "ctrlrange": "range of commands",
    "forcerange": "range of forces",
}  # for messages, where the field's name is not a word


def check_numbers(robot: str, mj: Any) -> None:
    """Checks that a model's numbers are within bounds; the ends of its ranges may be infinite.

    Raises:
        BadRobot: names the body, joint or actuator of a number that is not.
    """
    if not (np.abs(mj.opt.gravity) <= LARGEST).all():
        raise _bad(robot, "", "gravity", mj.opt.gravity)
    for table, largest in ((_NUMBERS, LARGEST), (_RANGES, np.inf)):
        for kind, field in [(kind, field) for kind, fields in table.items() for field in fields]:
            for i, row in enumerate(getattr(mj, f"{kind}_{field}")):
                if not (np.abs(row) <= largest).all():
                    raise _bad(robot, _part(mj, kind, i), field, row)


def _part(mj: Any, kind: str, i: int) -> str:
    """The name of a body, joint or actuator, or its number."""
    if kind == "body":
        return f"body {body_name(mj, i)}"
    if kind == "actuator":
        return f"actuator {mj.actuator(i).name or i + 1}"
    j = mj.dof_jntid[i] if kind == "dof" else i
    return f"joint {mj.joint(j).name or j + 1}"


def _bad(robot: str, part: str, field: str, row: Any) -> BadRobot:
    values = " ".join(f"{x:g}" for x in np.ravel(row))
    reason = f"its {_WORDS.get(field, field)} is {values}"
    return BadRobot(robot, part, reason, f"Write numbers of at most {LARGEST:g} in size.")
