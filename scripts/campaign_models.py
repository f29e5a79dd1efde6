"""Damaged models that are no URDF: MJCF files, and vehicles' sheets."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj.calibration.models import load_robot_model
from nsaid_mj.plants import ArmPlant
from nsaid_mj.resources import folder
from nsaid_mj.robot.loading import load_robot
from scripts.campaign_tries import Draw, Kind, Try, carried_out, typed

MJCF = """<mujoco model="two"><compiler angle="radian" meshdir="m"/><option density="0"/>
<default><joint damping="0.1" armature="0.01"/><default class="soft"><joint frictionloss="0.2"/>
<position kp="20" kv="1"/></default></default>
<asset><mesh name="shell" file="shell.stl"/><texture name="wood" file="wood.png"/></asset>
<worldbody><light pos="0 0 3"/><body name="l1" pos="0.4 0 0"><inertial pos="0.2 0 0" mass="2"
 diaginertia="0.02 0.02 0.02"/><joint name="j1" type="hinge" axis="0 0 1" range="-2 2"/>
<geom name="g1" type="capsule" size="0.03" fromto="0 0 0 0.4 0 0"/><geom type="mesh" mesh="shell"/>
<body name="l2" pos="0.4 0 0" quat="1 0 0 0"><joint name="j2" class="soft" axis="0 1 0"/>
<geom name="g2" type="box" size="0.1 0.02 0.02" mass="1"/><site name="tip" pos="0.2 0 0"/>
<body name="l3"><joint name="j3" type="slide" axis="1 0 0" range="0 0.1"/><geom type="sphere"
 size="0.02" mass="0.1"/></body></body></body></worldbody>
<tendon><fixed name="pair"><joint joint="j2" coef="1"/></fixed></tendon>
<equality><joint joint1="j3" joint2="j2" polycoef="0 0.1 0 0 0" active="false"/></equality>
<actuator><motor name="m1" joint="j1" gear="1" ctrlrange="-5 5"/>
<position name="m2" class="soft" joint="j2" forcerange="-3 3"/><motor joint="j3"/></actuator>
<sensor><jointpos joint="j1"/></sensor><keyframe><key qpos="0 0 0"/></keyframe></mujoco>
"""
"""An arm of three joints, with a servo, a coupling that is off, and files that are not there."""

_VALUES = ("", "nan", "inf", "-1", "0", "1e300", "5e-324", "1e12", "x", "é", "1 2", "0 0 0", "true")
_VALUES += ("l1", "l2", "j1", "j2", "g1", "world", "ball", "free", "slide", "mesh", "soft", "auto")
_VALUES += ("&#10;", "&lt;", "a" * 300, "../..", "/", "-5 5 5", "1 1 1 1 1 1 1", "9" * 400)
_ADDED = (
    "<freejoint/>",
    '<joint type="ball"/>',
    '<joint name="j1"/>',
    "<geom/>",
    '<include file="robot.xml"/>',
    '<include file="none.xml"/>',
    '<include file=""/>',
    '<replicate count="3"><body/></replicate>',
    '<replicate count="-1"/>',
    '<attach model="x" body="y"/>',
    '<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 9"/></body>',
    '<general joint="j1" gainprm="nan" biastype="affine"/>',
    '<position joint="j1" kp="-3"/>',
    '<weld body1="l1" body2="l2"/>',
    '<spatial><site site="tip"/><site site="tip"/></spatial>',
    '<plugin plugin="x"/>',
    '<size memory="1T"/>',
    '<option gravity="0 0 nan"/>',
    '<compiler inertiafromgeom="true"/>',
    '<compiler settotalmass="-3"/>',
    "<x/>",
)
_BYTES = (b"\xff", b"\0", b"<", b">", b'"', b"&", b"\xc3", b"<!--", b"]]>", b"\xef\xbb\xbf", b"")


def mjcf(rng: random.Random) -> bytes:
    """The good MJCF with one to three damages."""
    text = MJCF
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind = rng.random()
        if kind < 0.5:
            text = _another(text, r'="([^"]*)"', rng.choice(_VALUES), rng)
        elif kind < 0.6:
            text = _another(text, r' (\w+="[^"]*")', "", rng)
        elif kind < 0.8:
            text = _another(text, r"(<(?:joint|geom|inertial|motor|body|mesh)\b[^>]*/>)", "", rng)
        else:
            places = [m.end() for m in re.finditer(r"<\w+[^/>]*>|</\w+>", text)] or [0]
            at = rng.choice(places)
            text = text[:at] + rng.choice(_ADDED) + text[at:]
    content = text.encode(rng.choice(("utf-8",) * 8 + ("utf-16", "latin-1")), "replace")
    if rng.random() < 0.1:
        at = rng.randrange(len(content))
        content = content[:at] + rng.choice(_BYTES) + content[at + rng.choice((0, 1, 50, 9999)) :]
    return content


def _another(text: str, pattern: str, value: str, rng: random.Random) -> str:
    """A text with another value in one of the places that a pattern's group finds."""
    places = list(re.finditer(pattern, text))
    if not places:
        return text
    start, end = rng.choice(places).span(1)
    return text[:start] + value + text[end:]


def mjcfs(rng: random.Random, here: Path) -> Kind:
    """A damaged MJCF is simulated, or read to be identified."""
    content, path = mjcf(rng), here / "robot.xml"
    path.write_bytes(content)

    def simulated() -> str:
        truth = ArmPlant(str(path)).build(1e-3, 0).truth
        return "" if np.isfinite(truth).all() else f"a plant of {truth}"

    def floating() -> str:
        inertias = list(load_robot(str(path), "free").model.inertias)[1:]
        return _finite([i.toDynamicParameters() for i in inertias])

    def modelled() -> str:
        robot = load_robot_model(str(path))
        numbers = [i.toDynamicParameters() for i in list(robot.model.inertias)[1:]]
        own = (robot.damping, robot.friction, robot.rotor, robot.gain)
        return _finite(numbers) or _finite(own) or ("NaN" if np.isnan(robot.limits).any() else "")

    action = rng.choice((simulated, floating, modelled, modelled))
    return Kind(f"{action.__name__}, {content!r}", lambda: typed(action))


def _finite(numbers: Any) -> str:
    return "" if np.isfinite(numbers).all() else f"numbers that are not finite: {numbers}"


_TOML = ("nan", "-inf", "-1", "0", "1e300", "1e-300", "9" * 400, "true", '""', '"x"', "[]", "{}")
_TOML += ("[1, 2]", "[[1]]", "[nan, 1, 1]", "{a = 1}", "1979-05-27", "'é'", '"\\u0000"', "1_0", "")
_TOML += (
    "[1, 1, 1, 1, 1, 1]",
    "[0, 0, 0]",
    '"columns"',
    '"drag"',
    "2",
    "3.5",
    "1e9",
    "[1e9, 1, 1]",
)


def sheets(rng: random.Random, here: Path) -> Kind:
    """A damaged sheet of a vehicle is read to be identified, and to be simulated."""
    source = rng.choice(sorted(folder("assets").glob("*/vehicle.toml")))
    text = source.read_text(encoding="utf-8")
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind = rng.random()
        if kind < 0.6:
            text = _another(text, r"(?m)^[\w.]+ *= *([^#\n]+)", rng.choice(_TOML) + " ", rng)
        elif kind < 0.75:
            text = _another(text, r"(?m)^(.*\n)", "", rng)
        elif kind < 0.9:
            text = _another(text, r"(?m)^\[*([\w.]+)", rng.choice(("x", "kind", "mass", "é")), rng)
        else:
            text = _another(
                text, r"(?m)^()", rng.choice(("[[column]]\n", "x = 1\n", "[", "\0")), rng
            )
    path = here / "vehicle.toml"
    path.write_bytes(text.encode(rng.choice(("utf-8",) * 9 + ("utf-16",))))

    def modelled() -> str:
        prior = load_robot_model(str(path)).prior
        return _finite([] if prior is None else prior)

    return Kind(f"{source.parent.name}: {text}", lambda: typed(modelled))


FAMILIES: dict[str, Draw] = {"MJCF files": mjcfs, "vehicles' sheets": sheets}


def carry_out(family: str, tries: int, seed: int) -> Iterator[Try]:
    """The first tries of a family."""
    return carried_out(family, FAMILIES[family], tries, seed)
