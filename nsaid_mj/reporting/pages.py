"""Renders HTML pages from templates: one self-contained file each, with every value escaped.

All pages extend `templates/base.html`, whose first comment says what a page consists of. The
functions here make the values that its blocks and the macros of `templates/parts.html` take.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from .palette import COLOURS, DARK

_TEMPLATES = Path(__file__).parent / "templates"

GLYPHS = {"good": "✔", "fair": "◐", "poor": "✘", "weak": "○"}
"""Kinds of marks, classes of the style sheet, with the glyph that makes colour unnecessary."""


def mark(kind: str, text: str, glyph: str = "") -> dict[str, str]:
    """A badge: a status in words, with colour and glyph; `kind` is a key of `GLYPHS`."""
    return {"kind": kind, "glyph": glyph or GLYPHS[kind], "text": text}


def verdict(kind: str, text: str, glyph: str = "") -> dict[str, str]:
    """The sentence at the top of a page, with the figure that carries it in words."""
    return mark(kind, text, glyph)


def alarm(text: str, kind: str = "fair", level: str = "note", glyph: str = "▲") -> dict[str, str]:
    """A line below the verdict: what the reader has to know before believing it."""
    return {"kind": kind, "glyph": glyph, "level": level, "text": text}


def again(commands: Sequence[str], versions: dict[str, str], *notes: Any) -> dict[str, Any]:
    """How to make the results again.

    Args:
        commands: command lines or code, one block each.
        versions: by name, of this package and of what its results depend on.
        notes: paragraphs below; `markupsafe.Markup` is not escaped.
    """
    told = ", ".join(f"{name} {number}" for name, number in versions.items())
    return {"commands": list(commands), "notes": list(notes), "versions": told}


def block(
    name: str,
    heads: Sequence[str],
    lines: Sequence[Sequence[Any]],
    *,
    text: Sequence[int] = (0,),
    open: bool = False,
    counts: Sequence[dict[str, str]] = (),
) -> dict[str, Any]:
    """A table for the macro `folded`.

    Args:
        name: of the block of parameters.
        heads: of the columns.
        lines: cells; a mark becomes a badge.
        text: indices of the columns that are not numbers.
        open: whether it is unfolded on a screen; on paper it always is.
        counts: marks beside the name; the number of lines if there are none.
    """
    return {
        "name": name, "heads": list(heads), "lines": list(lines), "text": list(text),
        "open": open, "counts": list(counts),
    }  # fmt: skip


def render(template: str, **values: Any) -> str:
    """Renders a template.

    Args:
        template: file name of the template.
        values: variables of the template. Text is escaped unless it is `markupsafe.Markup`.
    """
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Any:
    import jinja2  # imported late: needed only after a run

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(light=COLOURS, dark=DARK)
    return environment
