"""Finds Rerun's viewer program and makes the command lines that start it."""

import os
import socket
import sys
from pathlib import Path

import rerun_cli

from ...base import BadRun

LOCAL = "127.0.0.1"
GRPC_PORT = 9876  # Rerun's defaults, used if they are free
WEB_PORT = 9090


def viewer_command(file: Path, web: bool) -> list[str]:
    """The command line that opens a recording, or with `web` serves it to a local browser.

    Raises:
        BadRun: there is no display to open a window on.
    """
    if not web:
        if not has_display():
            raise BadRun(
                file, "there is no display for a window", "Add --web to serve it to a browser"
            )
        return [*program(), str(file), *listening(free_port(GRPC_PORT))]
    return [*program(), str(file), *serving(free_port(GRPC_PORT), free_port(WEB_PORT))]


def listening(port: int) -> list[str]:
    """Flags for a viewer that listens on the loopback interface; Rerun's default is all of them."""
    return ["--bind", LOCAL, "--port", str(port)]


def serving(port: int, web_port: int) -> list[str]:
    """Flags that serve the viewer to browsers on this machine only."""
    return ["--serve-web", *listening(port), "--web-viewer-port", str(web_port)]


def program() -> list[str]:
    """Command of the viewer binary; terminating Rerun's console script would leave it running.

    The viewer sends no usage data unless the user sets FORCE_RERUN_ANALYTICS: it sends none where
    `CI` is set, and its file of settings does not tell a wish from a default.
    """
    os.environ.setdefault("CI", "true")  # of this process, which starts the viewer last
    folder = Path(rerun_cli.__file__).parent
    for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun", "rerun.exe"):
        if (folder / name).is_file():
            return [str(folder / name)]
    return [sys.executable, "-P", "-m", "rerun_cli"]


def has_display() -> bool:
    """Whether a window can be opened: always on macOS and Windows, else if X or Wayland runs."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_port(wish: int) -> int:
    """A free port on the loopback interface: `wish` if it is free, else any other."""
    for port in (wish, 0):
        with socket.socket() as probe:
            try:
                probe.bind((LOCAL, port))
            except OSError:
                continue
            return probe.getsockname()[1]
    return wish
