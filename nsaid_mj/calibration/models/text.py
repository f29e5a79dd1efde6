"""Model files as text: encodings, and XML that does not parse."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

from ...errors import BadRobot
from ..findings import Finding

_DECLARED = re.compile(rb"""^\s*<\?xml[^>]*encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")


def read_text(path: Path) -> tuple[str, tuple[Finding, ...]]:
    """The text of an XML file, and a finding if its encoding had to be guessed.

    The encoding is the declared one, UTF-8 if there is none, and Latin-1 if that fails.

    Raises:
        BadRobot: the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadRobot(str(path), "", reason, "Give the path of a readable file.") from error
    declared = _DECLARED.match(content)
    encoding = declared.group(1).decode() if declared else "utf-8"
    try:
        return content.decode("utf-8-sig" if encoding.lower() == "utf-8" else encoding), ()
    except (UnicodeDecodeError, LookupError):
        text = f"it is not valid {encoding}; it was read as Latin-1"
        found = Finding("note", "encoding", path.name, text, data={"encoding": encoding})
        return content.decode("latin-1"), (found,)


def parse(path: Path, text: str) -> ElementTree.Element:
    """The root element of an XML text.

    Raises:
        BadRobot: names the line that is not XML.
    """
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise BadRobot(str(path), "", f"it is not XML: {error}", "Correct the file.") from error


def root_tag(path: Path) -> str:
    """The name of a file's root element.

    Raises:
        BadRobot: the file cannot be read, or is not XML.
    """
    return parse(path, read_text(path)[0]).tag
