"""Writes a recording's file: collected in memory, then written atomically.

Rerun's own file sink hangs in its flush when the disk is full, and cannot be interrupted there.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import rerun as rr
import rerun_bindings

from ..resources import atomic_write
from .text import drawable


@contextmanager
def recording(name: str, blueprint: Any, file: Path) -> Iterator[rr.RecordingStream]:
    """Yields a recording stream; on exit its content is written to a file.

    Args:
        name: of the recording.
        blueprint: the viewer's layout.
        file: its path, ending in .rrd.

    Raises:
        NotWritten: the file cannot be written.
    """
    rec = rr.RecordingStream(drawable(f"nsaid_mj {name}"))
    memory = rec.memory_recording()
    _send_blueprint(rec, blueprint)
    try:
        yield rec
        with atomic_write(file) as partial, partial.open("wb") as stream:
            stream.write(memory.drain_as_bytes())
    finally:
        memory.drain_as_bytes()  # of data that are left after a failure, Rerun warns on stderr
        rec.disconnect()
        del rec, memory  # the last references, so that Rerun can end its threads
        rerun_bindings.flush_and_cleanup_orphaned_recordings()


def _send_blueprint(rec: rr.RecordingStream, blueprint: Any) -> None:
    """Sends a blueprint and ends the stream that Rerun makes for it, which else lives for ever.

    That stream holds itself in memory, with two threads and about 2 MB, and Rerun does not give it
    out; it is caught where it is made.
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
