"""Excitation: drivers that command a plant during identification, without its true parameters."""

from .. import numerics as numerics  # sets the kernels' cache folder before a kernel is compiled
from .adaptive import AdaptiveTracking as AdaptiveTracking
from .autopilot import DepthHeadingAutopilot as DepthHeadingAutopilot
from .driver import CompiledDriver as CompiledDriver
from .driver import Driver as Driver
from .driver import DriverConfig as DriverConfig
from .driver import InformedDriver as InformedDriver
from .driving import Driving as Driving
from .multisine import AxisMultisine as AxisMultisine
from .multisine import MultisineCommand as MultisineCommand
from .pose_hold import PoseHold as PoseHold
from .quadrotor import QuadrotorFlight as QuadrotorFlight
from .sequence import Phase as Phase
from .sequence import Sequence as Sequence
from .tracking import DesignedSignals as DesignedSignals
from .tracking import DesignedTracking as DesignedTracking
from .tracking import FourierTracking as FourierTracking
from .vehicle_manipulator import HoverAndReach as HoverAndReach
from .vehicle_manipulator import SwimAndReach as SwimAndReach
