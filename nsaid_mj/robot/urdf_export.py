"""Writes a URDF with identified inertias and frictions, all else unchanged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from ..errors import InvalidInput
from ..resources import write_text
from ..structure.optional import pin
from .identified import Identified, remarks
from .model import RobotModel
from .packages import model_file
from .text import read_text


class _Element(NamedTuple):
    """Where an element is in the text, in bytes."""

    tag: str
    name: str
    kind: str  # a joint's type
    child: str  # a joint's child link
    start: int
    body: int  # end of the opening tag
    end: int
    parts: dict[str, tuple[int, int]]  # its <inertial> or <dynamics>, start and end


def write_urdf(robot: RobotModel, values: Identified, path: Path) -> None:
    """Writes a robot's URDF with identified values.

    `<inertial>` and `<dynamics>` of moving links and joints are replaced; everything else is kept
    as it is, comments and meshes included. A moving link carries the inertia of all links welded to
    it, theirs being removed. Gains, rotor inertias and the scale's anchor are in a comment.

    Args:
        robot: as read from a URDF.
        values: what was identified.
        path: of the file to write.

    Raises:
        InvalidInput: the robot was not read from a URDF.
    """
    if robot.kind != "urdf":
        raise InvalidInput("robot", "one read from a URDF", robot.kind, "Write an MJCF file.")
    data = read_text(model_file(robot))[0].encode()
    elements = list(_elements(data))
    moved = {e.child: e.name for e in elements if e.tag == "joint" and e.name in robot.joints}
    edits: list[tuple[int, int, str]] = []
    welded = []
    for element in elements:
        if element.tag == "joint" and element.name in robot.joints:
            k = robot.joints.index(element.name)
            friction = (
                f'damping="{_exact(values.damping[k])}" friction="{_exact(values.friction[k])}"'
            )
            edits.append(_replaced(data, element, "dynamics", f"<dynamics {friction}/>"))
        elif element.tag == "link" and element.name in moved:
            inertia = values.model.inertias[values.model.getJointId(moved[element.name])]
            edits.append(_replaced(data, element, "inertial", _inertial(inertia)))
        elif (
            element.tag == "link" and "inertial" in element.parts and _moves(values.model, element)
        ):
            edits.append((*element.parts["inertial"], ""))
            welded.append(element.name)
    held = [e.name for e in elements if e.tag == "joint" and e.kind not in {"", "fixed"}]
    held = [name for name in held if name not in robot.joints]
    also = ("Joints taken as fixed: " + ", ".join(held) + ".",) if held else ()
    if welded:
        whose = "Their inertia is part of the link that they are fixed to: "
        also += (whose + ", ".join(welded) + ".",)
    top = next(e for e in elements if e.tag == "robot").body
    edits.append((top, top, f"\n<!-- {remarks(robot, values, also)} -->"))
    for start, end, text in sorted(edits, reverse=True):
        data = data[:start] + text.encode() + data[end:]
    write_text(path, _as_utf8(data.decode()))


def _moves(model: pin.Model, link: _Element) -> bool:
    """Whether a link moves with one of a model's joints."""
    frame = model.getFrameId(link.name, pin.FrameType.BODY)
    return frame < model.nframes and model.frames[frame].parentJoint > 0


def _inertial(inertia: pin.Inertia) -> str:
    """An inertia about the link's frame as an `<inertial>` element."""
    tensor = inertia.inertia
    places = [(i, j) for i in range(3) for j in range(i, 3)]
    moments = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{_exact(tensor[i, j])}"' for i, j in places)
    centre = " ".join(_exact(x) for x in inertia.lever)
    return (
        f'<inertial>\n      <origin xyz="{centre}" rpy="0 0 0"/>\n'
        f'      <mass value="{_exact(inertia.mass)}"/>\n      <inertia {moments}/>\n    </inertial>'
    )


def _replaced(data: bytes, element: _Element, part: str, text: str) -> tuple[int, int, str]:
    """The edit that puts a new part into an element, in place of the old one if there is one."""
    if part in element.parts:
        return (*element.parts[part], text)
    if element.body < element.end:
        return element.body, element.body, f"\n    {text}"
    slash = data.rindex(b"/", element.start, element.end)  # <link name="tool"/>
    return slash, element.end, f">\n    {text}\n  </{element.tag}>"


def _elements(data: bytes) -> Iterator[_Element]:
    """The robot, its links and its joints in a URDF's text (UTF-8)."""
    found: list[_Element] = []
    open_elements: list[tuple[str, dict[str, str], int, _Element | None]] = []
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        at, element = parser.CurrentByteIndex, None
        expected = ("robot",) if not open_elements else ("link", "joint")
        if tag in expected and len(open_elements) < 2:
            name, kind = attributes.get("name", ""), attributes.get("type", "")
            element = _Element(tag, name, kind, "", at, _tag_end(data, at), -1, {})
        open_elements.append((tag, attributes, at, element))
        if tag == "child" and len(open_elements) == 3 and (joint := open_elements[1][3]):
            open_elements[1] = (*open_elements[1][:3], joint._replace(child=attributes["link"]))

    def end(tag: str) -> None:
        _, _, at, element = open_elements.pop()
        stop = _tag_end(data, at)
        if data[stop - 2] != ord("/"):  # not <empty/>
            stop = _tag_end(data, parser.CurrentByteIndex)
        if element is not None:
            found.append(element._replace(end=stop))
        elif tag in {"inertial", "dynamics"} and len(open_elements) == 2:
            parent = open_elements[1][3]
            if parent is not None:
                parent.parts[tag] = at, stop

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    yield from found


def _tag_end(data: bytes, start: int) -> int:
    """The byte after the tag that begins at `start`; attributes may contain '>'."""
    quote, at = 0, start
    while quote or data[at] != ord(">"):
        if quote:
            quote = 0 if data[at] == quote else quote
        elif data[at] in b"\"'":
            quote = data[at]
        at += 1
    return at + 1


def _as_utf8(text: str) -> str:
    """A text whose XML declaration names no other encoding than UTF-8."""
    head, found, rest = text.partition("?>")
    if not (found and head.lstrip().startswith("<?xml")):
        return text
    return '<?xml version="1.0" encoding="UTF-8"?>' + rest


def _exact(value: float) -> str:
    return repr(float(value))
