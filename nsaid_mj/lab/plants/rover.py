"""A four-wheeled rover with simulated ground contact, which a linear tyre only approximates."""

from typing import Any

import mujoco
import numpy as np

from ...core import Array, Block, SingleBody
from ...robots import asset, published_numbers, set_options
from .single_track import operation, planar_mass, single_track
from .world.body import BODY, hidden
from .world.coordinates import LevelMap
from .world.mismatch import Mismatch
from .world.plant import Plant
from .world.simulated import GeomLooks

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
STEERED = ("steer_left", "steer_right")
_SETTLE = 3.0  # time until the rover has settled on its wheels [s]


class Rover(Plant):
    """A hull with six degrees of freedom, four wheels and a steering rack, with contact enabled.

    The rear motors are wired in series: they share one current, and each has its own torque
    constant. The rack turns each front wheel by its own angle (Ackermann steering).

    No θ reproduces the motion, so there is no true θ. `truth` is calculated from the parts, for a
    car on linear tyres: mass, first moment and inertia of the whole including wheels; motor torque
    and bearing friction at the wheels' radius; and the lateral force of MuJoCo's contact per unit
    of slip, at cruising speed. Estimates should be judged by their force predictions, not by this
    θ: in scenarios/rover.py those of NS-AID are better.

    `spread` is the largest relative deviation of the hidden parameters, which `rng` draws; the
    effects of `mismatch` add to the structural ones; `dt` is the time step [s].
    """

    system: SingleBody
    mismatches = (
        "MuJoCo's contact model at the wheels: lateral force depends on slip velocity, not slip "
        "angle, and saturates at friction times load",
        "load transfer between the wheels, and heave, pitch and roll of the hull",
        "rotational inertia of the wheels, which adds to the mass in forward motion only",
        "yaw moment from the unequal torques of the two motors",
        "lag of the steering servo, and different steering angles of the two front wheels",
    )

    def __init__(self, spread: float, mismatch: Mismatch, dt: float, rng: np.random.Generator):
        d = published_numbers("rover")
        self.system = structure(d)
        spec = rover_spec(d, dt, spread, rng)
        spec.option.wind = mismatch.flow
        self._compile(spec, mismatch)
        self.body = LevelMap(self.model, "pose")
        self._radius = d["radius"]
        self._arms = np.array([self.model.body(wheel).pos for wheel in WHEELS])  # (4, 3) [m]
        self._spins = np.array([self.model.joint(f"roll_{w}").dofadr[0] for w in WHEELS])
        self._rest = self._settled()
        self._truth = self._effective(d)
        self._looks = GeomLooks(self.model, self._show)
        self.reset(np.zeros(3), np.zeros(3))

    @property
    def truth(self) -> Array:
        """(9,) θ calculated from the parts; see the class."""
        return self._truth

    def _place(self, position: Array, velocity: Array) -> None:
        self.data.qpos[:] = self._rest
        self.body.write(self.data, position, velocity)
        along = velocity[0] - self._arms[:, 1] * velocity[2]
        self.data.qvel[self._spins] = along / self._radius  # rolling without slip

    def _show(self, data: Any, q: Array) -> None:
        """Poses the geoms at q (3,); wheels do not turn, as q has no angles."""
        data.qpos[:] = self._rest
        self.body.write(data, q, np.zeros(3))

    def coordinates(self) -> tuple[Array, Array]:
        """(3,) x, y [m], ψ [rad] and (3,) u, v [m/s], r [rad/s] of the hull's horizontal motion."""
        return self.body.read(self.data)

    def _settled(self) -> Array:
        """(nq,) qpos of the rover at rest at the origin, settled on its wheels."""
        mujoco.mj_resetData(self.model, self.data)
        with self.running():
            for _ in range(round(_SETTLE / self.dt)):
                mujoco.mj_step(self.model, self.data)
        self.body.write(self.data, np.zeros(3), np.zeros(3))
        return self.data.qpos.copy()

    def _effective(self, d: dict[str, Any]) -> Array:
        """(9,) θ of the equivalent car on linear tyres, calculated from the parts."""
        model = self.model
        data = self.data
        data.qpos[:] = self._rest
        data.qvel[:] = 0.0
        with self.running():
            mujoco.mj_forward(model, data)
        mass = model.body_mass[1:]
        place = data.xipos[1:]
        centre = mass @ place[:, 0] / mass.sum()
        spread = place[:, :2] - [centre, 0.0]
        turned = data.ximat[1:].reshape(-1, 3, 3)
        own = np.einsum("bi,bi->b", turned[:, 2] ** 2, model.body_inertia[1:])
        front, rear = (
            d["guess"]["speed"] * _stiffness(model, data, axle) for axle in ("front", "rear")
        )
        torque = model.wrap_prm[:2].sum()
        inertia = float(own.sum() + mass @ np.sum(spread**2, axis=1))
        M = planar_mass(float(mass.sum()), float(centre), inertia)
        drive = torque * model.actuator_gainprm[0, 0] / self._radius
        loss = -torque * torque * model.actuator_gainprm[0, 2] / self._radius**2
        rolling = model.dof_frictionloss[self._spins].sum() / self._radius
        forces = front, rear, drive, loss, rolling, _air_drag(model)
        return np.array([M[0, 0], M[1, 5], M[5, 5], *forces])


def structure(d: dict[str, Any]) -> SingleBody:
    """The structure for identifiers, with scales guessed from vehicle.toml's `d`."""
    guess = d["guess"]
    weight = d["mass"] * d["gravity"]
    drive = float(Block.guessed(2 * d["torque"] / d["radius"]))
    stiffness = float(Block.guessed(guess["stiffness"] * weight / 2))
    scale = [
        float(Block.guessed(d["mass"])),
        guess["off_centre"] * d["mass"] * d["wheelbase"],
        float(Block.guessed(d["mass"] * d["wheelbase"] ** 2 / 4)),
        stiffness,
        stiffness,
        drive,
        drive / d["top_speed"],
        guess["rolling"] * weight,
        0.5 * d["air"] * guess["drag_area"],
    ]
    ranges = operation(guess["speed"], guess["grip"], d["steering"], d["wheelbase"])
    nominal = np.array(scale)
    body = planar_mass(nominal[0], 0.0, nominal[2])
    return single_track(body, nominal[3:], nominal, d["wheelbase"], ranges).system


def rover_spec(d: dict[str, Any], dt: float, spread: float, rng: np.random.Generator) -> Any:
    """MuJoCo's specification of assets/rover/model.xml with hidden parameters, contact enabled."""

    def draw(value: Any) -> Any:
        return hidden(np.array(value), spread, rng)

    spec = mujoco.MjSpec.from_file(str(asset("rover", "model.xml")))
    set_options(spec, dt)
    needed = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    spec.option.disableflags &= ~int(needed)
    spec.option.gravity = [0, 0, -d["gravity"]]
    spec.option.density = d["air"]
    contact = d["contact"]
    hull = spec.body(BODY)
    hull.explicitinertial = True
    hull.mass = float(draw(d["mass"])) - 4 * d["wheel_mass"] - spec.body("rack").mass
    hull.ipos = draw(d["centre"])
    hull.iquat = [1, 0, 0, 0]
    # one factor for all keeps the triangle inequality
    hull.inertia = float(draw(1.0)) * np.array(d["inertia"])
    friction = float(draw(contact["friction"]))
    for wheel in WHEELS:
        body = spec.body(wheel)
        body.explicitinertial = True
        body.mass = d["wheel_mass"]
        body.ipos = [0, 0, 0]
        body.inertia = d["wheel_inertia"]
        spec.joint(f"roll_{wheel}").frictionloss = float(draw(d["bearing"]))
        pair = spec.add_pair(name=wheel, geomname1="ground", geomname2=f"tyre_{wheel}", condim=3)
        pair.friction = [friction, friction, 0, 0, 0]
        pair.solref[:2] = contact["normal"]
        pair.solreffriction[:2] = contact["creep"]
        pair.solimp[:2] = contact["impedance"]
    motors = spec.add_tendon(name="motors")
    for wheel in WHEELS[2:]:
        motors.wrap_joint(f"roll_{wheel}", float(draw(d["torque"])))
    drive = spec.add_actuator(name="drive", target="motors", trntype=mujoco.mjtTrn.mjTRN_TENDON)
    drive.gaintype = mujoco.mjtGain.mjGAIN_AFFINE
    nothing_left = 2 * d["torque"] * d["top_speed"] / d["radius"]  # the tendon's speed at the top
    drive.gainprm[:3] = [1.0, 0.0, -float(draw(1 / nothing_left))]
    servo = spec.add_actuator(name="steering", target="rack", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    stiffness, damping = (float(draw(d[f"servo_{what}"])) for what in ("stiffness", "damping"))
    servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    servo.gainprm[0] = stiffness
    servo.biasprm[:3] = [0.0, -stiffness, -damping]
    for joint, side in zip(STEERED, (1, -1), strict=True):
        link = spec.add_equality(name1=joint, name2="rack", type=mujoco.mjtEq.mjEQ_JOINT)
        link.objtype = mujoco.mjtObj.mjOBJ_JOINT
        link.data[:5] = ackermann(side * d["track"] / 2 / d["wheelbase"], d["steering"])
    return spec


def ackermann(offset: float, limit: float) -> Array:
    """(5,) polynomial of a front wheel's angle in that of a virtual wheel on the centre line.

    `offset` of the wheel is positive left, in wheelbases; `limit` is the virtual one's angle [rad].
    """
    angle = np.linspace(-limit, limit, 101)
    wheel = np.arctan(np.tan(angle) / (1 - offset * np.tan(angle)))
    coefficients = np.polynomial.Polynomial.fit(angle, wheel, 4).convert().coef
    return np.asarray(coefficients, dtype=np.float64)


def _stiffness(model: Any, data: Any, axle: str) -> float:
    """Lateral force of an axle per unit of lateral slip velocity, in steady cornering [N·s/m].

    A contact's force f and slip velocity v satisfy −B v = v̇ + R f (MuJoCo, Computation). In a
    corner v̇ is the centripetal acceleration, so that 1/R acts like a mass carried by the tyres.
    """
    first = np.array([contact.efc_address for contact in data.contact]) + 1  # after the normal's
    B = data.efc_KBIP[first, 1]
    R = data.efc_R[first]
    mass = model.body_mass.sum()
    here = [any(axle in model.geom(i).name for i in contact.geom) for contact in data.contact]
    return float(np.sum((B / R)[here]) * mass / (mass + np.sum(1 / R)))


def _air_drag(model: Any) -> float:
    """Drag along x of the bodies' equivalent inertia boxes, MuJoCo's fluid model [N·s²/m²]."""
    total = 0.0
    for mass, (xx, yy, zz) in zip(model.body_mass[1:], model.body_inertia[1:], strict=True):
        width, height = np.sqrt(6 * np.array([xx + zz - yy, xx + yy - zz]) / mass)
        total += 0.5 * model.opt.density * width * height
    return float(total)
