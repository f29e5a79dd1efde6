"""Renders HTML pages from templates: one self-contained file each, with every value escaped."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from .palette import COLOURS, DARK

_TEMPLATES = Path(__file__).parent / "templates"


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
