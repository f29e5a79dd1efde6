"""Vehicles of one body whose sheets are in the numbers that their literature publishes.

A converter for every family, in assets/families, turns these numbers into columns.
"""

from typing import ClassVar

from ...base import config
from ..fields import Share
from .world.blueprint import VehiclePlant


@config
class REMUS100Plant(VehiclePlant):
    """A REMUS 100, or another torpedo-shaped vehicle.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true drag, lift, weight, righting moment,
            propeller and fins from the published values.
    """

    family: ClassVar[str] = "torpedo"
    vehicle: str = "remus100"
    spread: Share = 0.2


@config
class BlueROV2Plant(VehiclePlant):
    """A BlueROV2 Heavy, or another underwater vehicle with fixed thrusters.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true drag, weight, righting moment and thrust
            from the published values.
    """

    family: ClassVar[str] = "underwater"
    vehicle: str = "bluerov2"
    spread: Share = 0.2


@config
class QuadrotorPlant(VehiclePlant):
    """A quadrotor in the air.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true mass, second moments of mass, drag, lift and
            thrust from the published values; half of it for the rotors' torque, because yaw
            authority is small.
    """

    family: ClassVar[str] = "quadrotor"
    vehicle: str = "hummingbird"
    spread: Share = 0.1


@config
class CarPlant(VehiclePlant):
    """A car that drives forwards on level ground.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true load, tyres, drive and resistances from the
            nominal values.
    """

    family: ClassVar[str] = "car"
    _refuses: ClassVar[tuple[str, ...]] = ("a car in the plane", "fluid", "level")
    vehicle: str = "f1tenth"
    spread: Share = 0.2


@config
class F1TenthPlant(CarPlant):
    """An F1TENTH, a race car at one tenth scale; parameters and sources in assets/f1tenth.

    Its attributes are those of `CarPlant`.
    """


@config
class BMW320iPlant(CarPlant):
    """A BMW 320i; parameters and sources in assets/bmw320i.

    Its attributes are those of `CarPlant`.
    """

    vehicle: str = "bmw320i"


@config
class AstrobeePlant(VehiclePlant):
    """NASA's Astrobee, or another free-flyer with two propulsion modules.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the nozzles' true thrust from the published value.
    """

    family: ClassVar[str] = "free-flyer"
    _refuses: ClassVar[tuple[str, ...]] = ("a free-flyer in a vacuum", "flow", "fluid")
    vehicle: str = "astrobee"
    spread: Share = 0.2
