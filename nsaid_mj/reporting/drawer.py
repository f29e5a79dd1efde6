"""Draws panels in a child process, which loads matplotlib while this one does other work."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from types import TracebackType
from typing import Any

from .panels import Curve, Panel

_TIMEOUT = 60.0  # after which a child is taken for stuck [s]


class Drawer:
    """Turns panels into SVG; a context in which the child process lives.

    matplotlib takes half a second to load. A run's end has other work for as long, so the child
    is started before it and asked after it. Where matplotlib is already loaded, or the child
    fails, this process draws; the bytes are the same.
    """

    def __init__(self) -> None:
        self._child: subprocess.Popen[str] | None = None

    def __enter__(self) -> Drawer:
        if "matplotlib.figure" not in sys.modules and sys.executable:
            # The child's path is this one's: neither the folder it starts in nor PYTHONPATH
            # may put another package before ours.
            code = f"import sys; sys.path = {sys.path!r}; from {__name__} import serve; serve()"
            with contextlib.suppress(OSError):
                self._child = subprocess.Popen(
                    [sys.executable, "-c", code],
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

    def draw(self, panels: Sequence[Panel]) -> list[str]:
        """An SVG element for each panel."""
        drawn = self._ask(panels)
        if drawn is None:
            from .plots import over_time

            drawn = [over_time(panel) for panel in panels]
        return drawn

    def _ask(self, panels: Sequence[Panel]) -> list[str] | None:
        """The child's drawings; None where there is no child or it does not answer."""
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


def _plain(panel: Panel) -> dict[str, Any]:
    """A panel as JSON takes it."""
    return asdict(panel) | {
        "curves": [
            asdict(curve) | {"t": curve.t.tolist(), "values": curve.values.tolist()}
            for curve in panel.curves
        ]
    }


# -- in the child ------------------------------------------------------------------------------


def serve() -> None:
    """Draws the panels that come on the standard input as JSON."""
    import numpy as np

    from .plots import over_time

    panels = []
    for told in json.load(sys.stdin):
        panel = Panel(**(told | {"curves": []}))
        for curve in told["curves"]:
            arrays = {key: np.array(curve[key], dtype=np.float64) for key in ("t", "values")}
            panel.curves.append(Curve(**(curve | arrays)))
        panels.append(panel)
    json.dump([over_time(panel) for panel in panels], sys.stdout)
