"""Tables, ids and legends of a page, read from its HTML."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import dataclass, field
from html import unescape
from html.parser import HTMLParser
from typing import Any

import pytest

_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
_VOID = {"meta", "br", "hr", "img", "link", "input"}


@dataclass
class Table:
    """One table's text.

    Attributes:
        around: classes of the element it stands in.
        heads: of the columns.
        rows: the cells under them.
    """

    around: str
    heads: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)


def unscripted(text: str) -> str:
    """A page without its one script.

    Raises:
        AssertionError: it has none, or several, or not the one that its policy allows.
    """
    (script,) = _SCRIPT.findall(text)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert "default-src 'none'" in text and f"script-src 'sha256-{digest}'" in text
    return _SCRIPT.sub("", text)


def data_of(drawing: str) -> list[dict[str, Any]]:
    """The axes and curves that a drawing tells to the page's script."""
    (data,) = re.findall("<metadata>(.*?)</metadata>", drawing, flags=re.DOTALL)
    return json.loads(unescape(data), parse_constant=pytest.fail)


class Page(HTMLParser):
    """What a page consists of."""

    def __init__(self) -> None:
        super().__init__()
        self.tables: list[Table] = []
        self.ids: list[str] = []
        self.legends: list[list[str]] = []
        self.heading = ""
        self._open: list[tuple[str, str]] = []

    @classmethod
    def of(cls, text: str) -> Page:
        """A page's text, read.

        Raises:
            AssertionError: a tag is not closed, or closed and not open.
        """
        page = cls()
        page.feed(text)
        page.close()
        assert not page._open, f"never closed: {page._open}"
        return page

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        kind = found.get("class", "")
        if "id" in found:
            self.ids.append(found["id"])
        if tag == "table":
            self.tables.append(Table(self._open[-1][1]))
        elif tag == "tr" and not any(open_ == "thead" for open_, _ in self._open):
            self.tables[-1].rows.append([])
        elif tag == "td":
            self.tables[-1].rows[-1].append("")
        elif tag == "th":
            self.tables[-1].heads.append("")
        elif tag == "ul" and kind == "legend":
            self.legends.append([])
        elif tag == "li" and self._open[-1][1] == "legend":
            self.legends[-1].append("")
        if tag not in _VOID:
            self._open.append((tag, kind))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [value or "" for name, value in attrs if name == "id"]

    def handle_endtag(self, tag: str) -> None:
        assert self._open, f"</{tag}> closes nothing"
        assert self._open[-1][0] == tag, f"</{tag}> closes <{self._open[-1][0]}>"
        self._open.pop()

    def handle_data(self, data: str) -> None:
        tag = self._open[-1][0] if self._open else ""
        if tag == "td":
            self.tables[-1].rows[-1][-1] += data
        elif tag == "th":
            self.tables[-1].heads[-1] += data
        elif tag == "h1":
            self.heading += data
        elif tag == "li" and len(self._open) > 1 and self._open[-2][1] == "legend":
            self.legends[-1][-1] += data
