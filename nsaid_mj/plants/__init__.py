"""MuJoCo as the world: the only importer of mujoco, and the only holder of the truth."""

from .. import numerics as numerics  # where kernels are kept: before the first one
from .aerial import QuadrotorPlant as QuadrotorPlant
from .arm import ArmPlant as ArmPlant
from .arm import FloatingBasePlant as FloatingBasePlant
from .ground import BMW320iPlant as BMW320iPlant
from .ground import F1TenthPlant as F1TenthPlant
from .rover import RoverPlant as RoverPlant
from .scalar_rov import ScalarRovPlant as ScalarRovPlant
from .space import AstrobeePlant as AstrobeePlant
from .torpedo import REMUS100Plant as REMUS100Plant
from .underwater import BlueROV2Plant as BlueROV2Plant
from .vehicle_manipulator import FlyingArmPlant as FlyingArmPlant
from .vehicle_manipulator import UvmsPlant as UvmsPlant
from .world.faults import Fault as Fault
from .world.mismatch import Mismatch as Mismatch
from .world.plant import Plant as Plant
from .world.plant import PlantConfig as PlantConfig
from .world.sensors import SensorNoise as SensorNoise
from .world.sensors import Sensors as Sensors
from .world.shapes import VisualMesh as VisualMesh
