"""Mimic joints of a URDF: joints whose position follows another one's.

Pinocchio's torque regressor does not support them, so that the link behind a mimic joint is welded
where its leader is at 0. Leader and follower are then one coordinate.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from lxml.etree import _Element as Element

from ..errors import BadRobot
from .findings import Finding


class Follower(NamedTuple):
    """How a mimic joint follows: q = multiplier · q_leader + offset.

    Attributes:
        leader: name of the joint that it follows.
        multiplier: ratio of the positions.
        offset: its position where the leader is at 0 [rad or m].
    """

    leader: str
    multiplier: float
    offset: float

    def position(self, leader: float) -> float:
        """The follower's position at a position of its leader."""
        return self.multiplier * leader + self.offset


def mimicking(path: Path, root: Element) -> dict[str, Follower]:
    """The mimic joints of a URDF by name, leaders resolved along chains.

    A joint that is said to follow one that does not exist moves freely. The numbers have been
    checked by `check_urdf`.

    Raises:
        BadRobot: a mimic joint follows itself.
    """
    found, joints = {}, {joint.get("name", ""): joint for joint in root.findall("joint")}
    for name, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is None or joint.get("type") == "fixed" or mimic.get("joint") not in joints:
            continue
        ratio, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
        found[name] = Follower(mimic.get("joint", ""), ratio, offset)
    return {name: _resolved(path, found, name) for name in found}


def weld(followers: dict[str, Follower], moving: set[str]) -> list[Finding]:
    """A warning about each of the joints that move which others follow."""
    findings = []
    for leader in dict.fromkeys(follower.leader for follower in followers.values()):
        if leader not in moving:
            continue
        names = [name for name, follower in followers.items() if follower.leader == leader]
        text = (
            f"it moves {', '.join(names)} with it (<mimic>); their links were welded where it is "
            "at 0, so the inertia of their own motion is not in the model"
        )
        data: dict[str, object] = {"followers": names}
        findings.append(Finding("warning", "mimic_joint", f"joint {leader}", text, data=data))
    return findings


def _resolved(path: Path, followers: dict[str, Follower], name: str) -> Follower:
    """A follower in terms of a leader that is not itself a follower."""
    found, passed = followers[name], {name}
    while found.leader in followers:
        if found.leader in passed:
            remedy = "Let one of them move freely."
            raise BadRobot(str(path), f"joint {name}", "it mimics itself in a circle", remedy)
        passed.add(found.leader)
        leader, multiplier, offset = followers[found.leader]
        factor = found.multiplier
        found = Follower(leader, factor * multiplier, factor * offset + found.offset)
    return found
