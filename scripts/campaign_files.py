"""Damaged URDF files, scripts, logs and maps, drawn for `campaign_inputs`."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

import numpy as np

_LINK = """<link name="{0}"><inertial><mass value="2.0"/><origin xyz="0.2 0 0" rpy="0 0 0"/><inertia
 ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """<joint name="{0}" type="{3}"><parent link="{1}"/><child link="{2}"/><origin
 xyz="0.4 0 0" rpy="1.5 0 0"/><axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" effort="100"
 velocity="3"/></joint>"""
GOOD = (
    '<?xml version="1.0"?><robot name="two"><link name="base"/>'
    + _LINK.format("l1")
    + _JOINT.format("j1", "base", "l1", "revolute")
    + _LINK.format("l2")
    + _JOINT.format("j2", "l1", "l2", "revolute")
    + _LINK.format("tool")
    + _JOINT.format("weld", "l2", "tool", "fixed")
    + "</robot>"
).encode()
"""A planar arm of two joints with a tool welded to it."""

_VALUES = ("", "nan", "inf", "-1", "0", "1e300", "5e-324", "5kg", "0,5", "1 2", "x", "é", "1e999")
_VALUES += (
    "world",
    "universe",
    "base",
    "l1",
    "l2",
    "j1",
    "revolute",
    "fixed",
    "floating",
    "planar",
)
_ODD = (b"\xff", b"\0", b"<", b">", b'"', b"&", b"\xc3", b"<!--", b"]]>", b"\xef\xbb\xbf", b"")


def urdf(rng: random.Random) -> bytes:
    """The good URDF with one to three damages."""
    content = GOOD
    for _ in range(rng.choice((1, 1, 2, 3))):
        content = rng.choice((_attribute, _attribute, _element, _bytes, _codec))(content, rng)
    return content


def _attribute(content: bytes, rng: random.Random) -> bytes:
    """Another value of an attribute."""
    places = list(re.finditer(rb'="([^"]*)"', content))
    if not places:
        return content
    start, end = rng.choice(places).span(1)
    return content[:start] + rng.choice(_VALUES).encode() + content[end:]


def _element(content: bytes, rng: random.Random) -> bytes:
    """An element left out, doubled, or added."""
    places = list(re.finditer(rb"<(link|joint|inertial|mass|origin|axis|limit|inertia)\b", content))
    if not places:
        return content
    place = rng.choice(places)
    tag, start = place.group(1), place.start()
    end = re.compile(rb"/>|</" + tag + rb">").search(content, start)
    stop = end.end() if end else len(content)
    part = content[start:stop]
    extra = rng.choice(
        (b'<mimic joint="j1"/>', b'<mimic joint="j2" multiplier="x"/>', b"<visual/>")
    )
    return content[:start] + rng.choice((b"", part + part, part + extra)) + content[stop:]


def _bytes(content: bytes, rng: random.Random) -> bytes:
    """Bytes put in, or a part cut out."""
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice(_ODD) + content[at + rng.choice((0, 0, 1, 50, 10_000)) :]


def _codec(content: bytes, rng: random.Random) -> bytes:
    """Another encoding, with a letter that is not ASCII."""
    text = content.decode("utf-8", "replace").replace("j1", "jé")
    return text.encode(rng.choice(("latin-1", "utf-16", "utf-8", "cp1252")), "replace")


_SCRIPT = """import numpy as np
from nsaid_mj import MultisineCommand, NullspaceAID, ScalarRovPlant, Scenario
from nsaid_mj.bounds import config
from nsaid_mj.control import Driver, DriverConfig
{top}
class Mine(Driver):
    def start(self):
        return {start}
    def command(self, t, q, v):
        return {command}
    def compiled(self, t):
        return {compiled}
@config
class MyDriver(DriverConfig):
    strength: float = {strength}
    def build(self, system, prior, rng):
        return {build}
{scenario}
"""
_SCENARIO = (
    "scenario = Scenario(ScalarRovPlant(), MyDriver(), duration=0.05, dt=0.01, held_out=0.05, "
    "pe_window=0.02)"
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
)
_ANY += ("np.zeros((1, 1))", "np.array([1e300])", "[[1], [2, 3]]", "object()", "undefined", "1/0")
_ANY += ("np.full(1, 1e12)", "(_ for _ in [1])", "np.array(['a'])", "exit(3)", "float('inf')")
_TOPS = ("", "", "x = (", "import nothing_here", "raise ValueError('[/x]')", "1/0", "exit()")
_TOPS += (
    "  indented",
    "def f(): return f()\nf()",
    "raise KeyError",
    "\0",
    "ü = 'ü'",
    "assert False",
)
_ENDS = ("", "scenario = 3", "scenario = Scenario", "scenario = Scenario(dt=-1)")
_ENDS += ("scenario = Scenario(plant=3)", "scenario = [Scenario()]", "scenario = MyDriver()")


def script(rng: random.Random) -> str:
    """A scenario's script with one or two mistakes."""
    parts = {
        "top": "",
        "start": "np.zeros(1), np.zeros(1)",
        "command": "np.zeros(1)",
        "compiled": "None",
        "strength": "1.0",
        "build": "Mine()",
        "scenario": _SCENARIO,
    }
    for part in rng.sample(list(parts), rng.choice((1, 1, 2))):
        choices = {"top": _TOPS, "scenario": _ENDS}.get(part, _ANY)
        parts[part] = rng.choice(choices)
    return _SCRIPT.format(**parts)


_N = 400
_T = np.arange(_N) / 100
_COLUMNS: dict[str, list[str]] = {"t": [f"{t:.3f}" for t in _T]}
for _joint, _phase in (("j1", 0.0), ("j2", 1.0)):
    _angle = 6 * _T + _phase
    _COLUMNS[f"q_{_joint}"] = [
        f"{x:.6f}" for x in 0.8 * np.sin(_angle) + 0.2 * np.sin(2.3 * _angle)
    ]
    _rate = 6 * (0.8 * np.cos(_angle) + 0.46 * np.cos(2.3 * _angle))
    _COLUMNS[f"v_{_joint}"] = [f"{x:.6f}" for x in _rate]
    _COLUMNS[f"tau_{_joint}"] = [f"{x:.6f}" for x in 5 * np.sin(_angle) + 0.5 * _rate]


def sound_log() -> bytes:
    """A CSV log of the arm without any damage."""
    rows = [",".join(_COLUMNS), *(",".join(row) for row in zip(*_COLUMNS.values(), strict=True))]
    return "\n".join(rows).encode()


def _cells(columns: dict[str, list[str]], rng: random.Random) -> None:
    column = rng.choice(list(columns))
    for _ in range(rng.choice((1, 5, 400))):
        columns[column][rng.randrange(_N)] = rng.choice(_VALUES)


def _whole(columns: dict[str, list[str]], rng: random.Random) -> None:
    column = rng.choice(list(columns))
    columns[column] = [rng.choice(_VALUES)] * _N


def _scaled(columns: dict[str, list[str]], rng: random.Random) -> None:
    column = rng.choice(list(columns))
    factor = rng.choice((-1.0, 1e3, 57.3, 1e9, 1e-12, 1e300, 0.0))
    columns[column] = [_times(x, factor) for x in columns[column]]


def _times(text: str, factor: float) -> str:
    try:
        return repr(factor * float(text))
    except ValueError:
        return text


def _renamed(columns: dict[str, list[str]], rng: random.Random) -> None:
    column = rng.choice(list(columns))
    columns[rng.choice(("", "time", "q_j1", "x,y", '"', "é", "a" * 500))] = columns.pop(column)


def _dropped(columns: dict[str, list[str]], rng: random.Random) -> None:
    del columns[rng.choice(list(columns))]


def _shuffled(columns: dict[str, list[str]], rng: random.Random) -> None:
    if "t" in columns:
        rng.shuffle(columns["t"])


_DAMAGES: tuple[Callable[[dict[str, list[str]], random.Random], None], ...] = (
    _cells,
    _whole,
    _scaled,
    _renamed,
    _dropped,
    _shuffled,
)


def log(rng: random.Random) -> bytes:
    """A CSV log with some damages."""
    columns = {name: list(values) for name, values in _COLUMNS.items()}
    for _ in range(rng.choice((0, 1, 1, 2))):
        rng.choice(_DAMAGES)(columns, rng)
    rows = [",".join(columns), *(",".join(row) for row in zip(*columns.values(), strict=False))]
    rows = rows[: rng.choice((len(rows), len(rows), len(rows), 1, 2, 3, 10))]
    text = rng.choice(("\n", "\n", "\r\n", ";\n", "\n\n")).join(rows)
    text = text.replace(",", rng.choice((",", ",", ",", ";", "\t", " ", ",,")))
    content = text.encode(rng.choice(("utf-8", "utf-8", "utf-16", "latin-1")), "replace")
    return _bytes(content, rng) if rng.random() < 0.2 else content


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


def table(rng: random.Random) -> bytes:
    """A map.toml, often damaged."""
    content = rng.choice(_MAPS).encode()
    for _ in range(rng.choice((0, 0, 1, 2))):
        kind = rng.random()
        if kind < 0.5:
            words = list(re.finditer(rng.choice((rb"[\w.]+", rb"-?\d[\d.]*")), content))
            if words:
                start, end = rng.choice(words).span()
                content = content[:start] + rng.choice(_VALUES).encode() + content[end:]
        else:
            content = _bytes(content, rng)
    return content
