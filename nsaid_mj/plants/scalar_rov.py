"""The 1-DOF vehicle (16): the heave axis of an ROV."""

from __future__ import annotations

from typing import Self

import mujoco
import numpy as np
from pydantic import model_validator

from ..bounds import Number, Positive, Share, config
from ..errors import InvalidInput
from ..parameters import Array
from ..resources import asset
from ..robot.shapes import VisualMesh, of_geom
from ..robot.tree import set_options
from ..systems.scalar import ScalarVehicle
from .world.coordinates import reading_of
from .world.mismatch import Mismatch
from .world.plant import ParametricPlantConfig, Plant


@config
class ScalarRovPlant(ParametricPlantConfig):
    """The heave axis of a BlueROV2 Heavy; parameters and sources in assets/scalar_rov.

    Attributes:
        mass: nominal mass, including added mass [kg].
        drag: nominal quadratic drag [N·s²/m²].
        net_weight: nominal weight minus buoyancy [N].
        gain: nominal thrust at full command [N].
        spread: largest relative deviation of the true values from the nominal ones.
    """

    mass: Positive = 32.18
    drag: Positive = 190.0
    net_weight: Number = 20.0
    gain: Positive = 160.0
    spread: Share = 0.2

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.net_weight == 0:
            raise InvalidInput(
                "plant.net_weight",
                "a number that is not 0",
                self.net_weight,
                "A neutral vehicle has no net weight to identify.",
            )
        self.mismatch.refuse("the heave axis alone", "flow", "fluid")
        return self

    def build(self, dt: float, seed: int) -> ScalarRov:
        """Draws the hidden parameters and makes the plant."""
        rng = np.random.default_rng(seed)
        return self.simulating(dt, self._nominal * (1 + self.spread * rng.uniform(-1, 1, 4)))

    def simulating(self, dt: float, theta: Array | None = None) -> ScalarRov:
        """Makes the plant with the true parameters θ (4,), or the published ones."""
        true = self._nominal if theta is None else theta
        return ScalarRov(self._nominal, true, dt, self.mismatch).failing(self.faults, self)

    @property
    def _nominal(self) -> Array:
        return np.array([self.mass, self.drag, self.net_weight, self.gain])


class ScalarRov(Plant):
    """A heaving vehicle in MuJoCo: slide joint, native quadratic damping, partial buoyancy.

    Args:
        nominal: (4,) an engineer's guess of m, d, g, a.
        theta: (4,) the true m, d, g, a.
        dt: time step [s].
        mismatch: the effects outside the structure.
    """

    def __init__(self, nominal: Array, theta: Array, dt: float, mismatch: Mismatch):
        self._theta = theta
        speed = float(np.sqrt(nominal[3] / nominal[1]))  # where drag balances full thrust
        self.system = ScalarVehicle(np.abs(nominal), speed)
        spec = mujoco.MjSpec.from_file(str(asset("scalar_rov", "model.xml")))
        set_options(spec, dt)
        mass, drag, weight, gain = theta
        body = spec.body("vehicle")
        body.mass = mass
        body.gravcomp = 1 - weight / (mass * 9.81)  # buoyancy as a share of the weight
        spec.joint("heave").damping = [0, drag, 0]  # MuJoCo: −(a v + b v|v| + c v³)
        spec.actuator("thrusters").gainprm[0] = gain
        self._compile(spec, mismatch)
        self.reading = reading_of(np.array([0]), np.array([0]))

    @property
    def truth(self) -> Array:
        """(4,) the true m, d, g, a."""
        return self._theta

    def _place(self, position: Array, velocity: Array) -> None:
        self.data.qpos[:], self.data.qvel[:] = position, velocity

    def coordinates(self) -> tuple[Array, Array]:
        """(1,) height [m] and (1,) velocity [m/s], positive upwards."""
        return self.data.qpos.copy(), self.data.qvel.copy()

    def visuals(self) -> list[VisualMesh]:
        """Meshes of hull and thrusters."""
        return [of_geom(self.model, i) for i in range(self.model.ngeom)]

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the geoms at heights q (k, 1).

        Returns:
            translations (k, geoms, 3) [m] and quaternions (k, geoms, 4) in x, y, z, w.
        """
        translations = np.repeat(self.model.geom_pos[None], len(q), axis=0)
        translations[:, :, 2] += q
        w, x, y, z = self.model.geom_quat.T
        return translations, np.repeat(np.stack([x, y, z, w], axis=1)[None], len(q), axis=0)
