"""Vehicles that are one body in MuJoCo: a free joint in space, or two slides and a hinge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from ...parameters import Array
from ...resources import asset
from ...systems.rigid_body import RigidBody
from .coordinates import PlanarMap, PoseMap
from .mismatch import Mismatch
from .plant import Plant, set_options
from .shapes import VisualMesh, of_geom

BODY = "vehicle"
"""Name of the moving body in every vehicle's model.xml; its free joint is called `pose`."""


NED = np.array([1.0, -1.0, -1.0])
"""Turns x forward, y right, z down into x forward, y left, z up, and back."""


class Vehicle(Plant):
    """One body and its actuators.

    Args:
        system: its structure.
        truth: (p,) the true θ.
        spec: MuJoCo's specification, of `vehicle_spec`, with the true inertia.
        numbers: what the callback reads from userdata.
        passive: the compiled callback that makes the body's forces, None for none.
        mismatch: what the structure does not know.
        gain_places: for every command where in `numbers` its actuator's gains are; empty where
            MuJoCo's actuators have them.
    """

    system: RigidBody

    def __init__(
        self,
        system: RigidBody,
        truth: Array,
        spec: Any,
        numbers: Array,
        passive: Any | None,
        mismatch: Mismatch,
        gain_places: Sequence[Sequence[int]] = (),
    ):
        self.system, self._truth, self.passive = system, truth, passive
        self.gain_places = gain_places
        spec.nuserdata = max(spec.nuserdata, len(numbers))
        self._numbers = numbers
        self._compile(spec, mismatch)
        self.body = PoseMap(self.model, "pose") if system.n == 6 else PlanarMap(self.model)
        self.reading = self.body.reading
        self.reset(np.zeros(system.n), np.zeros(system.n))

    @property
    def truth(self) -> Array:
        """(p,) the true θ."""
        return self._truth

    def _place(self, position: Array, velocity: Array) -> None:
        self.body.write(self.data, position, velocity)
        self.data.userdata[: len(self._numbers)] = self._numbers

    def coordinates(self) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) body twist."""
        return self.body.read(self.data)

    def visuals(self) -> list[VisualMesh]:
        """The body's geoms."""
        return [of_geom(self.model, i) for i in range(self.model.ngeom)]

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the geoms at poses q (k, m) of the body."""
        places, attitudes = body_poses(q)
        local = [_rotation(quaternion) for quaternion in self.model.geom_quat]
        translations = places[:, None] + np.einsum("kab,gb->kga", attitudes, self.model.geom_pos)
        quaternions = np.array(
            [[pin.Quaternion(R @ geom).coeffs() for geom in local] for R in attitudes]
        )
        return translations, quaternions.reshape(len(q), len(local), 4)


def body_poses(q: Array) -> tuple[Array, Array]:
    """(k, 3) places [m] and (k, 3, 3) attitudes of bodies at poses q (k, 7) or (k, 3)."""
    if q.shape[1] == 7:
        return q[:, :3], np.array([pin.Quaternion(row).toRotationMatrix() for row in q[:, 3:]])
    places = np.c_[q[:, :2], np.zeros(len(q))]
    return places, np.array([pin.utils.rotate("z", yaw) for yaw in q[:, 2]])


def vehicle_spec(name: str, dt: float, mass: float, centre: Array, inertia: Array) -> Any:
    """The specification of assets/<name>/model.xml with a given inertia, without gravity.

    Args:
        name: the vehicle.
        dt: step [s].
        mass: of the body [kg].
        centre: (3,) centre of mass in the body's axes [m].
        inertia: (3, 3) about the centre of mass [kg·m²].
    """
    spec = mujoco.MjSpec.from_file(str(asset(name, "model.xml")))
    set_options(spec, dt)
    spec.option.gravity = [0, 0, 0]
    body = spec.body(BODY)
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat = mass, centre, [1, 0, 0, 0]
    body.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return spec


def command_inputs(spec: Any, count: int, body: str = BODY) -> None:
    """Gives the model `count` commands that act through the callback only."""
    for i in range(count):
        actuator = spec.add_actuator(name=f"command {i + 1}", target=body)
        actuator.trntype = mujoco.mjtTrn.mjTRN_BODY
        actuator.gainprm[0] = 0.0


def hidden(nominal: Array | float, spread: float, rng: np.random.Generator) -> Array:
    """True numbers that deviate from nominal ones by up to ±spread, each by its own share."""
    nominal = np.asarray(nominal, dtype=np.float64)
    return nominal * (1 + spread * rng.uniform(-1, 1, nominal.shape))


def guessed(value: Array | float) -> Array:
    """The nearest powers of two: what one guesses of numbers without measuring."""
    return np.exp2(np.round(np.log2(np.abs(np.asarray(value, dtype=np.float64))))).astype(
        np.float64
    )


def _rotation(wxyz: Array) -> Array:
    return pin.Quaternion(*wxyz).toRotationMatrix()
