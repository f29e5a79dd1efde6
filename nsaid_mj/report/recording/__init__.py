"""Recordings for the Rerun viewer: run.rrd of a finished run, and live streaming during a run.

Only this package imports rerun, which the extra `view` installs; its names are imported on first
use. `scene` draws the robot, `forces` the actuator forces, `lines` the panels; `layout` arranges
them in the viewer. `run` writes a finished run, `live` streams a running one, and `viewer` finds
and starts Rerun's viewer.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ...base import RECORDING, installed, require

FILE = RECORDING
_HOMES = {"write": "run", "Live": "live", "viewer_command": "viewer", "record": "identification",
          "record_servos": "identification"}  # fmt: skip

if TYPE_CHECKING:
    from ...clinic import Live as Live
    from ...clinic import record as record
    from ...clinic import record_servos as record_servos
    from ...lab import write_run_recording as write_run_recording
    from .viewer import viewer_command as viewer_command


def available() -> bool:
    """Whether Rerun is installed, which recordings and the viewer need."""
    return installed("rerun")


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    require("rerun", "view", "A recording")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
