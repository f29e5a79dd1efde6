"""What drives a plant while it is identified. No driver knows a true parameter."""

from .driver import Driver as Driver
from .driver import DriverConfig as DriverConfig
from .multisine import MultisineCommand as MultisineCommand
from .quadrotor import QuadrotorFlight as QuadrotorFlight
from .tracking import FourierTracking as FourierTracking
