"""Sound URDF, MJCF, sheet, script, log and map files, and tables of the damages done to them."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

import numpy as np

from nsaid_mj.robots.assets import folder

_LINK = """<link name="{0}"><inertial><mass value="2.0"/><origin xyz="0.2 0 0" rpy="0 0 0"/><inertia
 ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """<joint name="{0}" type="{3}"><parent link="{1}"/><child link="{2}"/><origin
 xyz="0.4 0 0" rpy="1.5 0 0"/><axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" effort="100"
 velocity="3"/></joint>"""
URDF = (
    '<?xml version="1.0"?><robot name="two"><link name="base"/>'
    + _LINK.format("l1")
    + _JOINT.format("j1", "base", "l1", "revolute")
    + _LINK.format("l2")
    + _JOINT.format("j2", "l1", "l2", "revolute")
    + _LINK.format("tool")
    + _JOINT.format("weld", "l2", "tool", "fixed")
    + "</robot>"
)
"""A planar arm of two joints with a tool welded to it."""

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

_SCRIPT = """import numpy as np
from nsaid_mj import MultisineCommand, NullspaceAID, ScalarRovPlant, Scenario
from nsaid_mj.base.bounds import config
from nsaid_mj.lab.control.driver import Driver, DriverConfig

class Mine(Driver):
    def start(self):
        return np.zeros(1), np.zeros(1)
    def command(self, t, q, v):
        return np.zeros(1)
@config
class MyDriver(DriverConfig):
    strength: float = 1.0
    def build(self, system, prior, rng):
        return Mine()
scenario = Scenario(ScalarRovPlant(), MyDriver(), duration=0.05, dt=0.01, held_out=0.05,
                    pe_window=0.02)
"""
_MAPS = (
    '[time]\ncolumn = "t"\nunit = "s"\n',
    """[joints.j1]
position = {column = "q_j1", unit = "deg", sign = -1, offset = 0.5}
velocity = {column = "v_j1", unit = "rpm", ratio = 100}
command = {column = "tau_j1", unit = "mA"}
rest = 0.05
[joints.j2]
position = {column = "q_j2", points = [[-100, -1.9], [100, 1.9]]}
command = {column = "tau_j2"}
""",
    """hold = true
drop_rest = false
[joints.j1]
position = {column = "q_j1"}
velocity = {column = "v_j1"}
command = {column = "tau_j1"}
[joints.j2]
position = {column = "q_j2", unit = "ticks", counts_per_turn = 4096}
command = {column = "tau_j2"}
[coupling]
position = [[1, 0], [0.5, 1]]
torque = [[1, 0.5], [0, 1]]
[files."log.csv"]
offset = 1.5
""",
    """[vehicle]
position = ["q_j1", "q_j2", "t"]
euler = ["v_j1", "v_j2", "t"]
[actuators]
j1 = {column = "tau_j1"}
""",
    "hold = true\ndrop_rest = false\n",
)

OLD = "\x1a"  # in a replacement: what was there
_VALUES = (
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e300",
    "5e-324",
    "1e12",
    "1e999",
    "5kg",
    "0,5",
    "1 2",
    "0 0 0",
    "-5 5 5",
    "1 1 1 1 1 1 1",
    "x",
    "é",
    "true",
    "auto",
    "world",
    "universe",
    "base",
    "l1",
    "l2",
    "j1",
    "j2",
    "g1",
    "revolute",
    "fixed",
    "floating",
    "planar",
    "ball",
    "free",
    "slide",
    "mesh",
    "soft",
    "&#10;",
    "&lt;",
    "../..",
    "/",
    "a" * 300,
    "9" * 400,
)
_TOML = (
    "nan",
    "-inf",
    "-1",
    "0",
    "1e300",
    "1e-300",
    "9" * 400,
    "true",
    '""',
    '"x"',
    "[]",
    "{}",
    "[1, 2]",
    "[[1]]",
    "[nan, 1, 1]",
    "{a = 1}",
    "1979-05-27",
    "'é'",
    '"\\u0000"',
    "1_0",
    "",
    "[1, 1, 1, 1, 1, 1]",
    "[0, 0, 0]",
    '"columns"',
    '"drag"',
    "2",
    "3.5",
    "1e9",
    "[1e9, 1, 1]",
)
_ADDED = (
    "<freejoint/>",
    '<joint type="ball"/>',
    '<joint name="j1"/>',
    "<geom/>",
    "<x/>",
    '<include file="robot.xml"/>',
    '<include file="none.xml"/>',
    '<include file=""/>',
    '<replicate count="3"><body/></replicate>',
    '<replicate count="-1"/>',
    '<attach model="x" body="y"/>',
    '<weld body1="l1" body2="l2"/>',
    '<plugin plugin="x"/>',
    '<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 9"/></body>',
    '<general joint="j1" gainprm="nan" biastype="affine"/>',
    '<position joint="j1" kp="-3"/>',
    '<spatial><site site="tip"/><site site="tip"/></spatial>',
    '<size memory="1T"/>',
    '<option gravity="0 0 nan"/>',
    '<compiler inertiafromgeom="true"/>',
    '<compiler settotalmass="-3"/>',
)
_ANY = (
    "None",
    "3",
    "'x'",
    "[]",
    "{}",
    "np.zeros(3)",
    "np.array([np.nan])",
    "np.array([1j])",
    "1/0",
    "np.zeros((1, 1))",
    "np.array([1e300])",
    "[[1], [2, 3]]",
    "object()",
    "undefined",
    "np.full(1, 1e12)",
    "(_ for _ in [1])",
    "np.array(['a'])",
    "exit(3)",
    "float('inf')",
)
_TOPS = (
    "x = (",
    "import nothing_here",
    "raise ValueError('[/x]')",
    "1/0",
    "exit()",
    "\0",
    "  indented",
    "def f(): return f()\nf()",
    "raise KeyError",
    "ü = 'ü'",
    "assert False",
)
_ENDS = (
    "",
    "scenario = 3",
    "scenario = Scenario",
    "scenario = Scenario(dt=-1)",
    "scenario = Scenario(plant=3)",
    "scenario = [Scenario()]",
    "scenario = MyDriver()",
)
_ELEMENT = r"(?s)(<(link|joint|inertial|mass|origin|axis|limit|inertia)\b.*?(?:/>|</\2>))"

_Edit = tuple[float, str, Sequence[str]]
_EDITS: dict[str, tuple[_Edit, ...]] = {
    "urdf": (
        (0.6, r'="([^"]*)"', _VALUES),
        (
            0.3,
            _ELEMENT,
            (
                "",
                OLD + OLD,
                *(
                    OLD + more
                    for more in (
                        '<mimic joint="j1"/>',
                        '<mimic joint="j2" multiplier="x"/>',
                        "<visual/>",
                    )
                ),
            ),
        ),
        (0.1, r"(j1)", ("jé",)),
    ),
    "mjcf": (
        (0.5, r'="([^"]*)"', _VALUES),
        (0.1, r' (\w+="[^"]*")', ("",)),
        (0.2, r"(<(?:joint|geom|inertial|motor|body|mesh)\b[^>]*/>)", ("",)),
        (0.2, r"(?:<\w+[^/>]*>|</\w+>)()", _ADDED),
    ),
    "sheet": (
        (0.6, r"(?m)^[\w.]+ *= *([^#\n]+)", [f"{value} " for value in _TOML]),
        (0.15, r"(?m)^(.*\n)", ("",)),
        (0.15, r"(?m)^\[*([\w.]+)", ("x", "kind", "mass", "é")),
        (0.1, r"(?m)^()", ("[[column]]\n", "x = 1\n", "[", "\0")),
    ),
    "script": (
        (0.6, r"return (.*)", _ANY),
        (0.1, r"strength: float = (.*)", _ANY),
        (0.15, r"DriverConfig\n()", _TOPS),
        (0.15, r"(?s)\n(scenario = .*)", _ENDS),
    ),
    "map": ((0.5, r"([\w.]+)", _VALUES), (0.5, r"(-?\d[\d.]*)", _VALUES)),
}
"""For each kind of file: shares of damages, where they are done (group 1), and what is put there"""
_CODECS = ("utf-8",) * 12 + ("utf-16", "latin-1", "cp1252")
_BYTES = (b"\xff", b"\0", b"<", b">", b'"', b"&", b"\xc3", b"<!--", b"]]>", b"\xef\xbb\xbf", b"")


def damaged(kind: str, rng: random.Random) -> bytes:
    """A file of a kind of `_EDITS` with one to three damages; a map may also be sound."""
    text = {"urdf": URDF, "mjcf": MJCF, "script": _SCRIPT, "map": rng.choice(_MAPS)}.get(kind)
    if text is None:
        text = rng.choice(sorted(folder("assets").glob("*/vehicle.toml"))).read_text("utf-8")
    shares = [share for share, *_ in _EDITS[kind]]
    for _ in range(rng.choice((0, 0, 1, 2) if kind == "map" else (1, 1, 2, 3))):
        _, pattern, values = rng.choices(_EDITS[kind], shares)[0]
        if places := list(re.finditer(pattern, text)):
            start, end = rng.choice(places).span(1)
            text = text[:start] + rng.choice(values).replace(OLD, text[start:end]) + text[end:]
    content = text.encode(rng.choice(_CODECS), "replace")
    return _cut(content, rng) if rng.random() < 0.15 else content


def _cut(content: bytes, rng: random.Random) -> bytes:
    """Bytes put in, or a part cut out."""
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice(_BYTES) + content[at + rng.choice((0, 0, 1, 50, 10_000)) :]


# -- logs ------------------------------------------------------------------------------------------

Columns = dict[str, list[str]]
_T = np.arange(400) / 100


def _sound() -> Columns:
    columns = {"t": [f"{t:.3f}" for t in _T]}
    for joint, phase in (("j1", 0.0), ("j2", 1.0)):
        angle = 6 * _T + phase
        rate = 6 * (0.8 * np.cos(angle) + 0.46 * np.cos(2.3 * angle))
        position = 0.8 * np.sin(angle) + 0.2 * np.sin(2.3 * angle)
        values = {"q": position, "v": rate, "tau": 5 * np.sin(angle) + 0.5 * rate}
        columns |= {f"{k}_{joint}": [f"{x:.6f}" for x in each] for k, each in values.items()}
    return columns


def _lines(columns: Columns) -> list[str]:
    return [",".join(row) for row in (columns, *zip(*columns.values(), strict=False))]


def sound_log() -> bytes:
    """A CSV log of the arm without any damage."""
    return "\n".join(_lines(_sound())).encode()


def _cells(columns: Columns, name: str, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 5, 400))):
        columns[name][rng.randrange(len(_T))] = rng.choice(_VALUES)


def _whole(columns: Columns, name: str, rng: random.Random) -> None:
    columns[name] = [rng.choice(_VALUES)] * len(_T)


def _scaled(columns: Columns, name: str, rng: random.Random) -> None:
    factor = rng.choice((-1.0, 1e3, 57.3, 1e9, 1e-12, 1e300, 0.0))
    number = re.compile(r"-?\d+\.\d+")
    columns[name] = [repr(factor * float(x)) if number.fullmatch(x) else x for x in columns[name]]


def _renamed(columns: Columns, name: str, rng: random.Random) -> None:
    columns[rng.choice(("", "time", "q_j1", "x,y", '"', "é", "a" * 500))] = columns.pop(name)


def _dropped(columns: Columns, name: str, rng: random.Random) -> None:
    del columns[name]


def _shuffled(columns: Columns, name: str, rng: random.Random) -> None:
    rng.shuffle(columns["t" if "t" in columns else name])


_DAMAGES: tuple[Callable[[Columns, str, random.Random], None], ...] = (
    _cells,
    _whole,
    _scaled,
    _renamed,
    _dropped,
    _shuffled,
)


def log(rng: random.Random) -> bytes:
    """A CSV log with some damages."""
    columns = _sound()
    for _ in range(rng.choice((0, 1, 1, 2))):
        rng.choice(_DAMAGES)(columns, rng.choice(list(columns)), rng)
    rows = _lines(columns)
    rows = rows[: rng.choice((len(rows), len(rows), len(rows), 1, 2, 3, 10))]
    text = rng.choice(("\n", "\n", "\r\n", ";\n", "\n\n")).join(rows)
    text = text.replace(",", rng.choice((",", ",", ",", ";", "\t", " ", ",,")))
    content = text.encode(rng.choice(("utf-8", "utf-8", "utf-16", "latin-1")), "replace")
    return _cut(content, rng) if rng.random() < 0.2 else content
