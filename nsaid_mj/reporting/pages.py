"""HTML pages from templates: one self-contained file each, every value escaped."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from .palette import COLOURS, DARK

_TEMPLATES = Path(__file__).parent / "templates"


def render(template: str, **values: Any) -> str:
    """A page from a template.

    Args:
        template: its file's name.
        values: what the template speaks of. Text is escaped, but for `markupsafe.Markup`.
    """
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Any:
    import jinja2  # only now: a run writes its page when it has ended

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(light=COLOURS, dark=DARK)
    return environment
