"""Model files as XML by lxml, with comments, order and namespaces."""

import os
import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import numpy as np
from lxml import etree
from lxml.etree import _Element as Element

from ..base import Finding, InputFile, OutputFile
from .errors import BadRobot

_DECLARED = re.compile(rb"""^\s*<\?xml[^>]*encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_FILES = (
    "file",
    "filename",
    *(f"file{side}" for side in ("right", "left", "up", "down", "front", "back")),
)
"""Attributes of URDF and MJCF that name a file."""
_WIDE = (b"\xff\xfe", b"\xfe\xff")


def read_xml(path: Path) -> tuple[Element, list[Finding]]:
    """The root element of a file, and a finding if its encoding had to be guessed.

    The encoding is the declared one, UTF-8 if there is none, and Latin-1 if that fails.

    Raises:
        BadRobot: the file cannot be read, or is not XML; the message names the line.
    """
    try:
        content = InputFile(path).read()
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadRobot(str(path), "", reason, "Give the path of a readable file.") from error
    declared = _DECLARED.match(content)
    findings = []
    encoding = declared.group(1).decode() if declared else "utf-8"
    if content.startswith(_WIDE):
        encoding = "utf-16"
    try:
        text = content.decode("utf-8-sig" if encoding.lower() == "utf-8" else encoding)
    except (UnicodeError, LookupError):
        text = content.decode("latin-1")
        remark = f"it is not valid {encoding}; it was read as Latin-1"
        findings = [Finding("note", "encoding", path.name, remark, data={"encoding": encoding})]
    try:
        return etree.fromstring(text.encode(), etree.XMLParser(encoding="utf-8")), findings
    except (etree.XMLSyntaxError, ValueError) as error:
        raise BadRobot(str(path), "", f"it is not XML: {error}", "Correct the file.") from error


def check_named_files(path: Path) -> None:
    """Checks a model file and the files that it names, before a library opens them.

    They count as read. Included files are searched too; a name is sought in every folder where
    MuJoCo and Pinocchio may look. Missing files are left to the library.

    Raises:
        BadRobot: a file is no regular one, or the model is not XML.
    """
    seen = {os.path.realpath(path)}
    roots = [(path, read_xml(path)[0])]
    while roots:
        here, root = roots.pop()
        included = {Path(node.get("file", "")).name for node in root.iter("include", "model")}
        for file in _named_files(here.parent, path.parent, root):
            if os.path.realpath(file) in seen or file.is_dir():
                continue
            seen.add(os.path.realpath(file))
            try:
                InputFile(file).check()
            except OSError as error:
                reason = f"it names {file}: {error.strerror}"
                raise BadRobot(str(path), "", reason, "Give a regular file.") from error
            if file.name in included:
                with suppress(BadRobot):  # the library says what is wrong with it
                    roots.append((file, read_xml(file)[0]))


def _named_files(here: Path, main: Path, root: Element) -> set[Path]:
    """The files that exist of those named below an element, in a file of the folder `here`.

    `main` is the folder of the file that includes it.
    """
    folders = {here, main}
    names = set[str]()
    for node in root.iter(etree.Element):
        inside = [node.get(key) for key in ("meshdir", "texturedir", "assetdir")]
        folders |= {base / value for value in inside if value for base in (here, main)}
        names |= {value for key in _FILES if (value := node.get(key))}
    plain = {name.partition("://")[2] or name for name in names}
    paths = {folder / name for folder in folders for name in plain if "\0" not in name}
    return {file for file in paths if os.path.lexists(file)}


def write_xml(path: Path, root: Element, remarks: str) -> None:
    """Writes a document as UTF-8, with remarks as a comment at the top of its root."""
    OutputFile(path).write_text(with_remarks(root, remarks))


def with_remarks(root: Element, remarks: str) -> str:
    """A document as text, with remarks as a comment at the top of its root."""
    text = re.sub("-(?=-)", "- ", remarks).rstrip("-")  # a comment may not contain two hyphens
    comment = etree.Comment(f" {text} ")
    root.insert(0, comment)
    comment.tail = root.text or "\n"
    root.text = "\n"
    declaration = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return declaration + etree.tostring(root.getroottree(), encoding="unicode") + "\n"


def numbers(values: float | Iterable[float]) -> str:
    """Numbers with all their digits, as an attribute."""
    return " ".join(repr(float(x)) for x in np.ravel(values))  # type: ignore[arg-type]
