"""What are a robot's true parameters, plant and actuators together, seen only by how it moves?

Nullspace adaptive identification (NS-AID) on MuJoCo. Names are imported when first used, so that
`import nsaid_mj` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from .cli.commands import main as main
    from .control import DepthHeadingAutopilot as DepthHeadingAutopilot
    from .control import DriverConfig as DriverConfig
    from .control import Driving as Driving
    from .control import FourierTracking as FourierTracking
    from .control import HoverAndReach as HoverAndReach
    from .control import MultisineCommand as MultisineCommand
    from .control import PoseHold as PoseHold
    from .control import QuadrotorFlight as QuadrotorFlight
    from .control import SwimAndReach as SwimAndReach
    from .errors import NsaidError as NsaidError
    from .experiment.loop import run as run
    from .experiment.record import Record as Record
    from .experiment.scenario import Scenario as Scenario
    from .identifiers import ConventionalAID as ConventionalAID
    from .identifiers import MemoryConfig as MemoryConfig
    from .identifiers import NullspaceAID as NullspaceAID
    from .identifiers import Status as Status
    from .log import Measurement as Measurement
    from .parameters import Block as Block
    from .parameters import ParameterSpace as ParameterSpace
    from .plants import ArmPlant as ArmPlant
    from .plants import AstrobeePlant as AstrobeePlant
    from .plants import BlueROV2Plant as BlueROV2Plant
    from .plants import BMW320iPlant as BMW320iPlant
    from .plants import F1TenthPlant as F1TenthPlant
    from .plants import Fault as Fault
    from .plants import FloatingBasePlant as FloatingBasePlant
    from .plants import FlyingArmPlant as FlyingArmPlant
    from .plants import Mismatch as Mismatch
    from .plants import QuadrotorPlant as QuadrotorPlant
    from .plants import REMUS100Plant as REMUS100Plant
    from .plants import RoverPlant as RoverPlant
    from .plants import ScalarRovPlant as ScalarRovPlant
    from .plants import SensorNoise as SensorNoise
    from .plants import UvmsPlant as UvmsPlant
    from .system import SecondOrderSystem as SecondOrderSystem

_HOMES = {
    "main": "cli",
    "DepthHeadingAutopilot": "control",
    "DriverConfig": "control",
    "Driving": "control",
    "FourierTracking": "control",
    "HoverAndReach": "control",
    "SwimAndReach": "control",
    "MultisineCommand": "control",
    "QuadrotorFlight": "control",
    "NsaidError": "errors",
    "run": "experiment.loop",
    "ConventionalAID": "identifiers",
    "MemoryConfig": "identifiers",
    "NullspaceAID": "identifiers",
    "Status": "identifiers",
    "Block": "parameters",
    "ParameterSpace": "parameters",
    "ArmPlant": "plants",
    "AstrobeePlant": "plants",
    "PoseHold": "control",
    "BlueROV2Plant": "plants",
    "BMW320iPlant": "plants",
    "F1TenthPlant": "plants",
    "FloatingBasePlant": "plants",
    "Fault": "plants",
    "FlyingArmPlant": "plants",
    "Mismatch": "plants",
    "QuadrotorPlant": "plants",
    "REMUS100Plant": "plants",
    "RoverPlant": "plants",
    "ScalarRovPlant": "plants",
    "SensorNoise": "plants",
    "UvmsPlant": "plants",
    "Record": "experiment.record",
    "Scenario": "experiment.scenario",
    "Measurement": "log",
    "SecondOrderSystem": "system",
}

__all__ = sorted(_HOMES)  # noqa: PLE0605 (computed, and equal to the names above)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
