"""Matches channels to joints by name, where there is no map.

A channel's name is divided into words: the joint's name or index, words for a quantity (`position`,
`vel`, `tau` …), and the rest. Channels that differ only in the joint are a group, and a group with
a channel for every joint supplies that quantity.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence

from ...robots import RobotModel
from .mapping import FACTORS, ColumnMap, Joint, Map, Quantity, of_name
from .unusable import UnmatchedChannels


def _set(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


WORDS: dict[Quantity, frozenset[str]] = {
    "position": _set("position positions pos q qs angle angles ang theta enc encoder qpos"),
    "velocity": _set("velocity velocities vel dq qd v qdot speed spd omega qvel dtheta"),
    "command": _set(
        "effort efforts torque torques tau current currents cur curr i u cmd command ctrl control "
        "force moment voltage pwm esc throttle thr thrust thruster amps"
    ),
}
_OTHER = _set(
    "acceleration acc accel ddq qdd error err temperature temp status mode limit max min kp kd "
    "enable enabled disabled flag fault ready"
)
_WANTED = _set("target desired des cmd command commanded ref reference setpoint goal sp")
_FORWARD = _set("ff feedforward forward")
_TARGET = _WANTED | {"action"}
_CONTROL = _set("control ctrl")  # with a word of positions they are targets, alone they are forces
_MEASURED = _set("actual measured meas act fb feedback present real state")
_NAMES = {"position": "position", "velocity": "velocity", "command": "torque or current"}


class JointName(str):
    """A joint's name, by which it is known everywhere, with others that a log may have for it."""

    others: tuple[tuple[str, ...], ...] = ()  # words of each


def named(robot: RobotModel) -> tuple[JointName, ...]:
    """A robot's joints, with the names of their actuators, and without the words that all share.

    A column `q_FL_hip` belongs to `FL_hip_joint` if that joint's motor is called `FL_hip`, or if
    the names of all joints end in `joint`. A name that two joints could have counts for none.
    """
    own = [words(joint) for joint in robot.joints]
    shared = set.intersection(*map(set, own)) if len(own) > 1 else set()
    short = [tuple(word for word in each if word not in shared) for each in own]
    motors = [tuple(words(motor)) for motor in robot.motors or robot.joints]
    taken = [tuple(each) for each in own]
    quantities = frozenset().union(*WORDS.values(), _OTHER, _TARGET, _MEASURED)
    found = []
    for k, joint in enumerate(robot.joints):
        name = JointName(joint)
        name.others = tuple(
            other
            for other in dict.fromkeys((motors[k], short[k]))
            if other not in taken
            and (motors + short).count(other) <= (motors[k] == other) + (short[k] == other)
            and any(word.isalpha() and word not in quantities for word in other)
        )
        found.append(name)
    return tuple(found)


ADD_PD = (
    "If a controller makes the motors' torques by a PD law of known gains, state them in map.toml "
    "below a line `[pd]`: `kp = 20`, `kd = 1.5` with its numbers [N·m/rad, N·m·s/rad; one, a list, "
    "or a table by joint]. To have kp identified, give an MJCF with position servos (`<position>`)."
)


_NO_TARGETS = (
    "With `[pd]` commands are position targets, and no channels are named as such (`q_des_1`, "
    "`elbow_target`). Name the target of every joint in map.toml: `[joints.elbow]`, `position = "
    '{ column = "…" }`, `command = { column = "…" }`.'
)


def match(
    channels: Sequence[str],
    joints: Sequence[str],
    passive: Sequence[str] = (),
    under_pd: bool = False,
) -> Map:
    """The map of channels whose names give joint and quantity, for the robot's moving joints.

    The `passive` ones among them need no command. With `under_pd` commands are position targets,
    with target velocities and feed-forward torques where the log has them.

    Raises:
        UnmatchedChannels: a joint has no position or command, or there are several candidates.
    """
    groups = candidates(channels, joints, passive)
    driven = [joint for joint in joints if joint not in passive]
    targets = match_targets(channels, driven)
    if under_pd:
        groups["command"] = {"targets": targets} if targets else {}
    chosen: dict[Quantity, dict[str, str]] = {}
    missing = []
    reasons = []
    for quantity, found in groups.items():
        if len(found) == 1:
            (chosen[quantity],) = found.values()
        elif len(found) > 1:
            missing.append(f"the {_NAMES[quantity]} of every joint")
            reasons.append(f"{_NAMES[quantity].capitalize()} could be {' or '.join(found)}.")
        elif quantity != "velocity":
            missing.append(f"the {_NAMES[quantity]} of every joint")
            idle = passive if quantity == "command" else ()
            own = [joint for joint in joints if joint not in idle]
            if quantity == "command" and under_pd:
                missing[-1] = "the position target of every joint"
                reasons.append(_NO_TARGETS)
            else:
                reasons.append(_lacking(quantity, channels, own))
            if quantity == "command" and targets and not under_pd:
                first = next(iter(targets.values()))
                reasons.append(f"There are position targets ({first} …). {ADD_PD}")
    if missing:
        raise UnmatchedChannels(missing, [*reasons, *_fewer(channels, joints)], channels)
    positions, velocities, commands = (
        {joint: ColumnMap(column=channel) for joint, channel in chosen.get(quantity, {}).items()}
        for quantity in WORDS
    )
    rates: dict[str, str] = {}
    forward: dict[str, str] = {}
    if under_pd:
        rates = set_points("velocity", channels, driven)
        forward = set_points("command", channels, driven)
    each = {
        j: Joint(
            positions[j],
            commands.get(j),
            velocities.get(j),
            target_velocity=ColumnMap(column=rates[j]) if j in rates else None,
            feedforward=ColumnMap(column=forward[j]) if j in forward else None,
        )
        for j in joints
    }
    return Map(joints=each)


def set_points(
    quantity: Quantity, channels: Iterable[str], joints: Sequence[str]
) -> dict[str, str]:
    """The channels of set-points by joint, such as target velocities and feed-forward torques.

    Empty unless one group has all joints.
    """
    groups = [
        by_joint
        for (kind, group, rank), members in _members(channels, joints).items()
        if kind == quantity and (rank == 2 or _FORWARD & set(group.split()))
        if (by_joint := _by_joint(members, joints, group))
    ]
    return groups[0] if len(groups) == 1 else {}


def match_targets(channels: Iterable[str], joints: Sequence[str]) -> dict[str, str]:
    """The channels of position targets by joint; empty if the names are ambiguous.

    A target's name has its joint and a word such as `target` or `goal` beside words of positions:
    `target_elbow`, `elbow.goal_position`, `action.elbow.pos`.
    """
    groups = _targets(channels, joints)
    found = [own for group, members in groups.items() if (own := _by_joint(members, joints, group))]
    return found[0] if len(found) == 1 else {}


def gain_columns(channels: Iterable[str], joints: Sequence[str]) -> dict[str, dict[str, str]]:
    """The channels of a PD law's gains, kp and kd, by joint; without one that names do not tell."""
    groups: dict[tuple[str, str], dict[str, str]] = defaultdict(dict)
    for channel in channels:
        joint, rest = _joint_of(words(channel), joints)
        for key in {"kp", "kd"} & set(rest) if joint else ():
            groups[key, " ".join(rest)].setdefault(joint, channel)
    found = {}
    for (key, group), members in groups.items():
        if own := _by_joint(members, joints, group):
            found[key] = own
    return found


def lacking_targets(channels: Iterable[str], joints: Sequence[str]) -> list[str]:
    """The joints without a target if some joints have one by name; else empty."""
    most = max(_targets(channels, joints).values(), key=len, default={})
    lacking = [joint for joint in joints if joint not in most]
    return lacking if len(lacking) < len(joints) else []


def _targets(channels: Iterable[str], joints: Sequence[str]) -> dict[str, dict[str, str]]:
    """Channels of position targets by group and joint (its name, or a number as text)."""
    groups: dict[str, dict[str, str]] = defaultdict(dict)
    others = _OTHER | WORDS["velocity"] | (WORDS["command"] - {"cmd", "command"})
    for channel in channels:
        joint, rest = _joint_of(words(channel), joints)
        said = set(rest)
        if said & WORDS["position"]:
            said = said - _CONTROL | ({"target"} if said & _CONTROL else set())
        if joint and said & _TARGET and not said & others:
            groups[" ".join(rest)].setdefault(joint, channel)
    return groups


def _lacking(quantity: Quantity, channels: Iterable[str], joints: Sequence[str]) -> str:
    """Says which joints lack a channel of a quantity, or how many numbered channels there are."""
    found = _members(channels, joints)
    named = {joint for match, members in found.items() if match[0] == quantity for joint in members}
    unnamed = [joint for joint in joints if joint not in named]
    if len(unnamed) < len(joints):
        return f"No channel names a {_NAMES[quantity]} of {', '.join(unnamed)}."
    numbered = [members for match, members in found.items() if match[0] == quantity]
    if numbered:
        most = list(max(numbered, key=len).values())
        return (
            f"A {_NAMES[quantity]} is numbered in {len(most)} channels ({most[0]} … {most[-1]}), "
            f"and the robot's moving joints are {len(joints)}: {', '.join(joints)}."
        )
    return f"No channels name a {_NAMES[quantity]} for each of {', '.join(joints)}."


def _fewer(channels: Iterable[str], joints: Sequence[str]) -> list[str]:
    """How to lock the joints that the log does not cover according to its names or numbers."""
    named: dict[Quantity, set[str]] = {quantity: set() for quantity in WORDS}
    counts: dict[Quantity, int] = dict.fromkeys(WORDS, 0)
    for (quantity, _, _), members in _members(channels, joints).items():
        named[quantity] |= set(members)
        counts[quantity] = max(counts[quantity], sum(key.isdigit() for key in members))
    own = [j for j in joints if j in named["position"] and j in named["command"]]
    if any(j in set().union(*named.values()) for j in set(joints) - set(own)):
        return []
    if own:
        return [f"If all other joints stood still, `--joints {','.join(own)}` locks them."]
    first = counts["position"]
    if first != counts["command"] or not 1 < first < len(joints):
        return []
    text = f"If the channels are the first {first} joints, and the others, as those of a gripper, "
    return [f"{text}stood still, `--lock {','.join(joints[first:])}` holds these."]


def candidates(
    channels: Iterable[str], joints: Sequence[str], passive: Sequence[str] = ()
) -> dict[Quantity, dict[str, dict[str, str]]]:
    """For each quantity, the groups of channels that cover all joints: joint to channel by group.

    Where no group of commands covers all of them, it may lack those of `passive` joints.
    Measured quantities take precedence over setpoints of the same quantity, and names of joints
    over numbers, which may belong to another arm in the log.
    """
    complete: dict[Quantity, dict[tuple[int, bool], dict[str, dict[str, str]]]]
    complete = {quantity: {} for quantity in WORDS}
    for (quantity, group, rank), members in _members(channels, joints).items():
        by_joint = _by_joint(members, joints, group)
        if by_joint:
            numbered = not set(joints) <= set(members)
            complete[quantity].setdefault((rank, numbered), {})[group] = by_joint
    found: dict[Quantity, dict[str, dict[str, str]]]
    found = {quantity: ranks[min(ranks)] if ranks else {} for quantity, ranks in complete.items()}
    if passive and not found["command"]:
        driven = [joint for joint in joints if joint not in passive]
        found["command"] = candidates(channels, driven)["command"]
    return found


def _members(
    channels: Iterable[str], joints: Sequence[str]
) -> dict[tuple[Quantity, str, int], dict[str, str]]:
    """Channels by joint (its name, or a number as text), for each quantity, group and rank."""
    groups: dict[tuple[Quantity, str, int], dict[str, str]] = defaultdict(dict)
    for channel in channels:
        if found := read(channel, joints):
            kind, joint = found
            groups[kind].setdefault(joint, channel)
    return groups


def _by_joint(members: dict[str, str], joints: Sequence[str], group: str) -> dict[str, str]:
    """Channels by joint name; empty if the group does not cover all joints."""
    if all(joint in members for joint in joints):
        return {joint: members[joint] for joint in joints}
    indices = sorted(int(key) for key in members if key.isdigit())
    own = set(group.split())
    if own >= {"motor", "state"} or own >= {"motor", "cmd"}:
        return _of_message(members, indices, joints)
    base = 7 if "qpos" in own else 6 if "qvel" in own else 0  # of MuJoCo's free joint
    if base and indices == list(range(base + len(joints))):
        indices = indices[base:]
    if len(indices) != len(joints) or indices[-1] - indices[0] != len(joints) - 1:
        return {}
    return {joint: members[str(k)] for joint, k in zip(joints, indices, strict=True)}


_LEGS = ("fr", "fl", "rr", "rl")
_PARTS = (("hip", "abad", "abduction"), ("thigh", "upper"), ("calf", "shank", "lower", "knee"))


def _of_message(
    members: dict[str, str], indices: Sequence[int], joints: Sequence[str]
) -> dict[str, str]:
    """Channels of Unitree's messages by joint name; empty if they have fewer motors than joints.

    A message has room for more motors than a robot has. Those of quadrupeds are numbered leg by
    leg, FR, FL, RR, RL, each hip, thigh, calf; those of other robots as the joints of their models.
    """
    if len(indices) < len(joints) or list(indices) != list(range(len(indices))):
        return {}
    order = list(joints)
    spelt = {joint: set(words(joint)) for joint in joints}
    legs = [
        [j for j in joints if leg in spelt[j] and spelt[j] & set(part)]
        for leg in _LEGS
        for part in _PARTS
    ]
    if len(joints) == len(legs) and all(len(own) == 1 for own in legs):
        order = [joint for (joint,) in legs]
    return {joint: members[str(k)] for k, joint in enumerate(order)}


def read(channel: str, joints: Sequence[str]) -> tuple[tuple[Quantity, str, int], str] | None:
    """The meaning of a channel's name; None if it names no joint or no quantity.

    It is quantity, group (the name without the joint) and rank, 0 for a measurement, 1 for a
    neutral name, 2 for a setpoint; and the joint's name, or its index as text.
    """
    bare = channel
    for factors in FACTORS.values():
        bare, unit = of_name(channel, factors)
        if unit and words(bare):
            break
    found = words(bare)
    joint, rest = _joint_of(found, joints)
    if not joint:
        return None
    said = {w for w in rest if w}
    if said & _OTHER:
        return None
    quantity = quantity_of(said, rest)
    if quantity is None:
        return None
    spare = said - ({"cmd", "command"} if quantity == "command" and not said - _WANTED else set())
    wanted = _WANTED | _CONTROL if quantity == "position" else _WANTED
    rank = 2 if spare & wanted else 0 if spare & _MEASURED else 1
    return (quantity, " ".join(rest), rank), joint


def quantity_of(said: set[str], rest: Sequence[str]) -> Quantity | None:
    """The quantity that the words of a channel's name give; None if none, or several."""
    text = " ".join(rest)
    if "q dot" in text or "d q" in text:
        return "velocity"
    if "q d dot" in text or "dd q" in text:
        return None
    if "velocity" in said or said & WORDS["velocity"]:
        return "velocity" if not said & (WORDS["position"] - {"q", "angle"}) else None
    if said & WORDS["position"]:
        return "position" if not said & {"torque", "tau", "effort"} else None
    return "command" if said & WORDS["command"] else None


def says_targets(name: str) -> bool:
    """Whether the name of a file says that it holds what was wanted, not what was measured."""
    return bool(set(words(name)) & (_TARGET | _CONTROL | _set("commands targets actions")))


def free_joint(channels: Iterable[str]) -> tuple[list[str], list[str]] | None:
    """The columns of positions and velocities of MuJoCo's state of a base with a free joint.

    They are numbered, `qpos_0` … and `qvel_0` …, and one more of the first than of the second. None
    without them.
    """
    found: dict[str, dict[int, str]] = {"qpos": {}, "qvel": {}}
    for channel in channels:
        own = words(channel)
        if len(own) > 1 and own[-2] in found and own[-1].isdigit():
            found[own[-2]].setdefault(int(own[-1]), channel)
    q, v = ([own[k] for k in range(len(own)) if k in own] for own in found.values())
    whole = len(q) == len(found["qpos"]) and len(v) == len(found["qvel"])
    return (q, v) if whole and len(v) > 6 and len(q) == len(v) + 1 else None


def words(name: str) -> list[str]:
    """A name's words in lower case; digits are separate words."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return re.findall(r"[a-z]+|\d+", spaced.lower())


def is_gripper(joint: str) -> bool:
    """Whether a joint is a gripper, whose position LeRobot counts from 0 to 100."""
    return bool({"gripper", "jaw"} & set(words(joint)))


def _joint_of(found: list[str], joints: Sequence[str]) -> tuple[str, list[str]]:
    """The joint that a name's words contain, and the words with `*` for it.

    The longest joint name that occurs wins; failing that, the last number is an index. A name
    without either belongs to a robot's only joint.
    """
    best = ""
    where = (0, 0)
    spelt = [(joint, words(joint)) for joint in joints]
    spelt += [(j, list(other)) for j in joints for other in getattr(j, "others", ())]
    for joint, own in spelt:
        for start in range(len(found) - len(own) + 1):
            if found[start : start + len(own)] == own and len(own) > where[1] - where[0]:
                best = joint
                where = (start, start + len(own))
    if best:
        return best, [*found[: where[0]], "*", *found[where[1] :]]
    numbers = [k for k, word in enumerate(found) if word.isdigit()]
    if not numbers:
        return (joints[0] if len(joints) == 1 else ""), found
    last = numbers[-1]
    return str(int(found[last])), [*found[:last], "*", *found[last + 1 :]]
