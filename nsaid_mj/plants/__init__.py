"""Plants simulated by MuJoCo; no other object holds the true parameters.

Every file in this folder is imported, and every `PlantConfig` in it is a name of this package.
"""

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from .. import numerics as numerics  # sets the kernels' cache folder before a kernel is compiled
from ..robot.shapes import VisualMesh as VisualMesh
from .world.faults.kinds import Bias as Bias
from .world.faults.kinds import Broken as Broken
from .world.faults.kinds import Fault as Fault
from .world.faults.kinds import Friction as Friction
from .world.faults.kinds import Loss as Loss
from .world.faults.kinds import Payload as Payload
from .world.faults.kinds import Reversed as Reversed
from .world.faults.kinds import Stuck as Stuck
from .world.faults.text import fault_text as fault_text
from .world.faults.text import parse_faults as parse_faults
from .world.mismatch import Mismatch as Mismatch
from .world.plant import Looks as Looks
from .world.plant import ParametricPlantConfig as ParametricPlantConfig
from .world.plant import Plant as Plant
from .world.plant import PlantConfig as PlantConfig
from .world.sensors import SensorNoise as SensorNoise
from .world.sensors import Sensors as Sensors


def _plants() -> dict[str, type[PlantConfig]]:
    """The plant classes defined in this folder's files, by name."""
    found = {}
    for file in iter_modules(__path__, f"{__name__}."):
        if not file.ispkg:
            classes = vars(import_module(file.name)).values()
            found |= {
                value.__name__: value
                for value in classes
                if isinstance(value, type)
                and issubclass(value, PlantConfig)
                and value.__module__ == file.name
            }
    return found


globals().update(_plants())


def __getattr__(name: str) -> Any:  # for type checkers, which cannot see the names above
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
