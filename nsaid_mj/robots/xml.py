"""Model files as XML by lxml, with comments, order and namespaces."""

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from lxml import etree
from lxml.etree import _Element as Element

from ..base import Finding, write_text
from .errors import BadRobot

_DECLARED = re.compile(rb"""^\s*<\?xml[^>]*encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_WIDE = (b"\xff\xfe", b"\xfe\xff")


def read_xml(path: Path) -> tuple[Element, list[Finding]]:
    """The root element of a file, and a finding if its encoding had to be guessed.

    The encoding is the declared one, UTF-8 if there is none, and Latin-1 if that fails.

    Raises:
        BadRobot: the file cannot be read, or is not XML; the message names the line.
    """
    try:
        content = path.read_bytes()
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


def write_xml(path: Path, root: Element, remarks: str) -> None:
    """Writes a document as UTF-8, with remarks as a comment at the top of its root."""
    write_text(path, with_remarks(root, remarks))


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
