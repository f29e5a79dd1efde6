"""Model files as text, with a finding where the encoding had to be guessed."""

from __future__ import annotations

from pathlib import Path

from . import urdf_checks
from .findings import Finding
from .urdf_checks import parse


def read_text(path: Path) -> tuple[str, tuple[Finding, ...]]:
    """The text of an XML file, and a finding if its encoding had to be guessed.

    The encoding is the declared one, UTF-8 if there is none, and Latin-1 if that fails.

    Raises:
        BadRobot: the file cannot be read.
    """
    text, encoding = urdf_checks.read_text(path)
    if not encoding:
        return text, ()
    guessed = f"it is not valid {encoding}; it was read as Latin-1"
    return text, (Finding("note", "encoding", path.name, guessed, data={"encoding": encoding}),)


def root_tag(path: Path) -> str:
    """The name of a file's root element.

    Raises:
        BadRobot: the file cannot be read, or is not XML.
    """
    return parse(path, read_text(path)[0]).tag
