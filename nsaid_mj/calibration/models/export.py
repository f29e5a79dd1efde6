"""Calibrated models and tables: the files that others use."""

from .identified import Identified, Parameter, with_inertias
from .mjcf_export import write_mjcf
from .replay import Replay, replay
from .tables import write_sysid, write_yaml
from .urdf_export import write_urdf

__all__ = [
    "Identified",
    "Parameter",
    "Replay",
    "replay",
    "with_inertias",
    "write_mjcf",
    "write_sysid",
    "write_urdf",
    "write_yaml",
]
