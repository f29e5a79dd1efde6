"""Writes a recording: layout, texts, robot and curves, collected in memory, written atomically.

Rerun's own file sink hangs in its flush when the disk is full, and cannot be interrupted there.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

from ...base import OutputFile
from .lines import Lines, key
from .plots import KEY
from .text import application, drawable

_MARKDOWN = rr.MediaType.MARKDOWN


def write_recording(
    file: Path,
    name: str,
    layout: rrb.Blueprint,
    documents: Mapping[str, str],
    lines: Sequence[Lines],
    draw: Callable[[rr.RecordingStream], None],
) -> Path:
    """Writes a recording atomically.

    Args:
        file: path of the recording, ending in .rrd; it is returned.
        name: name of the recording.
        layout: layout of the viewer.
        documents: Markdown, by entity.
        lines: the curves.
        draw: logs the robot.

    Raises:
        NotWritten: the file cannot be written.
    """
    rec = rr.RecordingStream(application(name))
    memory = rec.memory_recording()
    _send_blueprint(rec, layout)
    try:
        explained = {KEY: key(lines)} if key(lines) else {}
        for entity, text in {**documents, **explained}.items():
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
