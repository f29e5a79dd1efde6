"""Recordings: pages, texts, robot and curves, collected in memory and written atomically, or live.

Rerun's own file sink hangs in its flush when the disk is full, and cannot be interrupted there.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal
from unittest import mock

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

from ...base import OutputFile
from ..page import PageItem, item_lines
from .lines import Lines, key
from .plots import KEY
from .text import application, drawable

_MARKDOWN = rr.MediaType.MARKDOWN


def write_recording(
    file: Path,
    name: str,
    pages: Sequence[rrb.Container],
    documents: Mapping[str, str | Sequence[PageItem]],
    lines: Sequence[Lines],
    draw: Callable[[rr.RecordingStream], None],
) -> Path:
    """Writes a recording atomically.

    Args:
        file: path of the recording, ending in .rrd; it is returned.
        name: name of the recording.
        pages: of the viewer, the first of which is open.
        documents: Markdown, or parts of a page, by entity.
        lines: the curves.
        draw: logs the robot.

    Raises:
        NotWritten: the file cannot be written.
    """
    rec = rr.RecordingStream(application(name))
    memory = rec.memory_recording()
    _send_blueprint(rec, _layout(pages, "playing"))
    try:
        explained = {KEY: key(lines)} if key(lines) else {}
        for entity, told in {**documents, **explained}.items():
            text = told if isinstance(told, str) else "\n".join(item_lines(told))
            rec.log(entity, rr.TextDocument(drawable(text), media_type=_MARKDOWN), static=True)
        draw(rec)
        for one in lines:
            one.log(rec)
        with OutputFile(file).atomically() as partial, partial.open("wb") as stream:
            stream.write(memory.drain_as_bytes())
    finally:
        memory.drain_as_bytes()  # otherwise Rerun warns of data left after a failure, on stderr
        rec.disconnect()
        del rec, memory  # the last references, so that Rerun can end its threads
        rerun_bindings.flush_and_cleanup_orphaned_recordings()
    return file


def live_recording(address: str, name: str, pages: Sequence[rrb.Container]) -> rr.RecordingStream:
    """A recording that a viewer at an address shows while it is made.

    Args:
        address: of the viewer, as Rerun's `connect_grpc` takes it.
        name: name of the recording.
        pages: of the viewer, the first of which is open.
    """
    rec = rr.RecordingStream(application(name))
    rec.connect_grpc(address, default_blueprint=_layout(pages, "following"))
    return rec


def _layout(
    pages: Sequence[rrb.Container], play_state: Literal["playing", "following"]
) -> rrb.Blueprint:
    """Pages as tabs, the first one open, without the viewer's panels."""
    return rrb.Blueprint(
        rrb.Tabs(*pages, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline="sim_time", play_state=play_state, loop_mode="all"
        ),
        auto_views=False,
        auto_layout=False,
    )


def _send_blueprint(rec: rr.RecordingStream, blueprint: Any) -> None:
    """Sends a blueprint and ends Rerun's stream for it, which would otherwise never end.

    That stream holds itself in memory, with two threads and about 2 MB. Rerun does not expose it;
    it is caught where it is created.
    """
    made: list[rr.RecordingStream] = []
    wrap = rr.RecordingStream._from_native

    def caught(native: Any) -> rr.RecordingStream:
        made.append(wrap(native))
        return made[-1]

    with mock.patch.object(rr.RecordingStream, "_from_native", caught):
        rec.send_blueprint(blueprint)
    for stream in made:
        stream.disconnect()
