"""Errors and warnings about descriptions of robots."""

from __future__ import annotations

from collections.abc import Iterable

from ..base import NsaidError


class BadRobot(NsaidError):
    """A robot description that cannot be simulated.

    Attributes:
        robot: its name or file.
        part: the link or joint at fault; "" for the robot as a whole.
        reason: what is wrong with it.
        remedy: what to do about it.
    """

    def __init__(self, robot: str, part: str, reason: str, remedy: str):
        self.robot = robot
        self.part = part
        self.reason = reason
        self.remedy = remedy
        where = f", {part}" if part else ""
        super().__init__(f"robot {robot}{where}: {reason}. {remedy}")


class MimicIgnored(UserWarning):
    """Joints that follow others in a robot's description are simulated with their own motors.

    Attributes:
        robot: its name or file.
        joints: the joints.
    """

    def __init__(self, robot: str, joints: Iterable[str]):
        self.robot, self.joints = robot, tuple(joints)
        super().__init__(
            f"robot {robot}: <mimic> is ignored: every joint has its own motor, including "
            f"{', '.join(self.joints)}. Make a joint fixed if it should not move."
        )


class RobotChanged(UserWarning):
    """A robot's file is simulated with other numbers, or without some of its forces.

    Attributes:
        robot: its file.
        changes: what was changed or left out, in words.
    """

    def __init__(self, robot: str, changes: Iterable[str]):
        self.robot, self.changes = robot, tuple(changes)
        super().__init__(f"robot {robot}: {' '.join(self.changes)}")
