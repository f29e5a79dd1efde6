"""Watches the scheduler of a Dask cluster, whose death joblib would wait out for hours."""

from __future__ import annotations

import _thread
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..errors import InvalidInput

_SILENCE = 10.0  # without a connection for so long, the scheduler counts as dead [s]


@contextmanager
def watched(client: Any, address: str | None) -> Iterator[None]:
    """Within the context, the scheduler's death ends what the main thread waits for.

    Args:
        client: Dask's client.
        address: of the scheduler.

    Raises:
        InvalidInput: the scheduler has died.
    """
    dead, done = threading.Event(), threading.Event()

    def watch() -> None:
        seen = time.monotonic()
        while not done.wait(0.5):
            if client.status == "running":
                seen = time.monotonic()
            elif time.monotonic() > seen + _SILENCE:
                dead.set()
                _thread.interrupt_main()  # it waits in joblib, which would not notice
                return

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    except (KeyboardInterrupt, Exception) as error:
        lost = dead.is_set() or (isinstance(error, Exception) and client.status != "running")
        if not lost:
            raise
        raise InvalidInput(
            "address",
            "a scheduler that keeps running",
            f"none any more at {address}",
            "Start the cluster again; the same command then resumes the sweep.",
        ) from error
    finally:
        done.set()
        thread.join()
