"""Draws panels in a child process, which loads matplotlib in parallel to other work."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import is_dataclass
from types import TracebackType
from typing import Any

import numpy as np

from .panels import AnyPanel, Comparison, Curve, Forest, HeatMap, Panel

_TIMEOUT = 60.0  # after which the child counts as hung [s]


class Drawer:
    """Converts panels to SVG; a context manager that owns the child process.

    matplotlib takes half a second to load. Post-processing has other work in the meantime, so the
    child is started first and used last. If matplotlib is already loaded, or if the child fails,
    this process draws; the SVG is identical.
    """

    def __init__(self) -> None:
        self._child: subprocess.Popen[str] | None = None

    def __enter__(self) -> Drawer:
        if "matplotlib.figure" not in sys.modules and sys.executable:
            # The child uses this process's sys.path: neither its working directory nor PYTHONPATH
            # may shadow our package.
            code = f"import sys; sys.path = {sys.path!r}; from {__name__} import serve; serve()"
            with contextlib.suppress(OSError):
                self._child = subprocess.Popen(
                    [sys.executable, "-P", "-c", code],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    encoding="utf-8",
                )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.communicate()

    def draw(self, panels: Sequence[AnyPanel]) -> list[str]:
        """Draws one SVG element per panel."""
        drawn = self._ask(panels)
        if drawn is None:
            from .drawings import draw

            drawn = [draw(panel) for panel in panels]
        return drawn

    def _ask(self, panels: Sequence[AnyPanel]) -> list[str] | None:
        """The child's drawings; None if there is no child or it fails."""
        child, self._child = self._child, None
        if child is None:
            return None
        try:
            answer, _ = child.communicate(json.dumps([_plain(panel) for panel in panels]), _TIMEOUT)
            return json.loads(answer)
        except (OSError, ValueError, subprocess.TimeoutExpired):
            return None
        finally:
            child.kill()
            child.wait()


def _plain(value: Any) -> Any:
    """A panel as JSON-serialisable values; `kind` is the name of its class."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if is_dataclass(value):
        fields = {name: _plain(item) for name, item in vars(value).items()}
        return {"kind": type(value).__name__} | fields
    return value


# -- in the child ------------------------------------------------------------------------------


def serve() -> None:
    """Reads panels from the standard input as JSON and writes their SVG to the standard output."""
    from .drawings import draw

    json.dump([draw(_panel(fields)) for fields in json.load(sys.stdin)], sys.stdout)


def _panel(fields: dict[str, Any]) -> Any:
    """The panel, or curve, that `_plain` made these values from."""
    made = dict(fields)
    for name, value in fields.items():
        if isinstance(value, list) and name not in {"names", "legend"}:
            curves = name == "curves"
            made[name] = [_panel(curve) for curve in value] if curves else np.array(value)
    return _KINDS[made.pop("kind")](**made)


_KINDS: dict[str, Any] = {
    kind.__name__: kind for kind in (Comparison, Curve, Forest, HeatMap, Panel)
}
