"""Trees of revolute and prismatic joints (5), fixed or floating, with a motor on every joint.

θ = ten inertial parameters of every link, the floating base first if there is one; then, for every
joint, rotor inertia (if modelled), viscous and Coulomb friction; then the gain of every motor. Link
inertias are about the joint-frame origin in joint axes, in Pinocchio's order: m, m·c (3), Ixx, Ixy,
Iyy, Ixz, Iyz, Izz.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..dynamics.motions import RegressorMotion
from ..log import Log
from ..numerics.spatial import bracket
from ..parameters import Array, Block, ParameterSpace
from ..structure.parts import Inertia
from ..structure.structure import Structure
from ..system import Stage
from .general import balance_by_sample, difference_step, forces_by_sample
from .inertial import INERTIAL, INERTIAL_UNITS, inertial_labels
from .joints import (
    Actuator,
    JointTree,
    bodies_of,
    body_names,
    floats,
    joint_names,
    joint_parts,
    moving_joints,
    slides,
    without_inertia,
)
from .optional import pin
from .structured import plain

_ACTUATORS = {
    "motor": ("motor gain", "gain", ("N·m/unit", "N/unit")),
    "servo": ("servo gain", "kp", ("N·m/rad", "N/m")),
}
"""Block of θ, letter and units of the gains of each kind of actuator."""
_REGRESSOR = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)
_BASE_SPEED = 1.0  # largest speed of a floating base in probes of the structure [m/s, rad/s]


@dataclass(frozen=True)
class JointScales:
    """Data-sheet guesses for the b bodies and k joints of a robot.

    Attributes:
        mass: (b,) masses of the bodies, a floating base first [kg].
        length: (b,) sizes of the bodies [m].
        viscous: (k,) viscous friction [N·m·s/rad or N·s/m].
        coulomb: (k,) Coulomb friction [N·m or N].
        gain: (n_u,) motor gains [N·m or N per unit of command], or of servos [N·m/rad or N/m].
        speed: (k,) speeds of operation [rad/s or m/s].
        command: (n_u,) commands of operation [units of command].
        rotor: (k,) reflected rotor inertias [kg·m² or kg]; None omits them from θ.
        actuator: whether a command is a motor's, or the position target of a servo.
        driven: (n_u,) numbers of the joints that have an actuator; None for all.
    """

    mass: Array
    length: Array
    viscous: Array
    coulomb: Array
    gain: Array
    speed: Array
    command: Array
    rotor: Array | None = None
    actuator: Actuator = "motor"
    driven: tuple[int, ...] | None = None


class MotorTree(JointTree):
    """M(q, θ) v̇ + C(x, θ) v = −g(q, θ) − f(v, θ) + diag(k) u (5), with motors on joints only.

    Joints may be passive, without a motor; k then has a gain for each of the others.

    With position servos, whose commands are targets, the last term is diag(k) (u − q).

    C is Pinocchio's: with R_g and R_0 the joint torque regressors with and without gravity,
    C(q, v) w = R_0(q, (v+w)/2, ½[v, w]) π − R_0(q, (v−w)/2, 0) π, whose Ṁ − 2C is skew. [v, w] is
    the Lie bracket of the base's twists, 0 where the base is fixed: rates of joints commute.
    Friction is `viscous·v + coulomb·tanh(v/friction_speed)`.

    The regressors are supplied by `Multibody` (Pinocchio's) or `CompiledMultibody` (the
    structure's, which agree with Pinocchio's).

    Args:
        model: kinematics and gravity; its inertias are discarded.
        scales: data-sheet guesses, which become the scale of θ.
        friction_speed: (k,) joint speed at which Coulomb friction saturates [rad/s or m/s].
    """

    def __init__(self, model: pin.Model, scales: JointScales, friction_speed: Array):
        model = without_inertia(model)
        bodies, space, speed = bodies_of(model), _space(model, scales), np.asarray(friction_speed)
        links, joints = 10 * len(bodies), len(moving_joints(model))
        self.driven = np.arange(joints) if scales.driven is None else np.array(scales.driven, int)
        rotors, columns = joint_parts(
            model, links, scales.rotor is not None, speed, scales.actuator, self.driven.tolist()
        )
        rigid = [Inertia(b, 10 * b) for b in range(len(bodies))]
        gravity = model.gravity.linear.copy()
        structure = Structure(bodies, rigid, columns, len(space), len(self.driven), rotors, gravity)
        super().__init__(model, structure, space)
        self.scales, self.friction_speed = scales, speed.astype(np.float64)
        self._speed = np.concatenate([np.full(self.group, _BASE_SPEED), scales.speed])

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        u = self.scales.command * rng.uniform(-1, 1, self.n_u)
        return q, v, u if self.scales.actuator == "motor" else self.angles(q)[self.driven] + u


class Multibody(MotorTree):
    """A `MotorTree` whose regressors are Pinocchio's: the reference, several times slower.

    Its arguments are those of `MotorTree`.
    """

    def __init__(self, model: pin.Model, scales: JointScales, friction_speed: Array):
        super().__init__(model, scales, friction_speed)
        self._weightless = pin.Model(self.model)
        self._weightless.gravity.setZero()
        self._data, self._data_0 = self.model.createData(), self._weightless.createData()
        self._unit, self._zero = np.eye(self.n), np.zeros(self.n)
        self._joint, self._links = np.arange(len(self.joints)), 10 * self.bodies
        self._moved = self.group + self._joint  # the velocity of each joint
        self._rotor = None if scales.rotor is None else self._links
        self._gain = self.p - self.n_u
        self._viscous, self._coulomb = self._gain - len(self.joints) * np.array([2, 1])

    # -- regressors ----------------------------------------------------------------------------

    def _weighted(self, q: Array, v: Array, a: Array) -> Array:
        """(n, 10 b) Pinocchio's regressor with gravity; (1, 10 b) for one joint, not squeezed."""
        regressor = pin.computeJointTorqueRegressor(self.model, self._data, q, v, a)
        return regressor if self.n > 1 else regressor.reshape(1, -1)

    def _torque_regressor(self, q: Array, v: Array, a: Array) -> Array:
        """(n, 10 b) Pinocchio's regressor without gravity."""
        regressor = pin.computeJointTorqueRegressor(self._weightless, self._data_0, q, v, a)
        return regressor if self.n > 1 else regressor.reshape(1, -1)

    def _W_M(self, q: Array, a: Array) -> Array:
        W = np.zeros((self.n, self.p))
        W[:, : self._links] = self._torque_regressor(q, self._zero, a)
        if self._rotor is not None:
            W[self._moved, self._rotor + self._joint] = a[self.group :]
        return W

    def _mass_tensor(self, q: Array) -> Array:
        tensor = np.zeros((self.n, self.n, self.p))
        for j in range(self.n):
            tensor[j, :, : self._links] = self._torque_regressor(q, self._zero, self._unit[j])
        if self._rotor is not None:
            tensor[self._moved, self._moved, self._rotor + self._joint] = 1.0
        return tensor

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        W = np.zeros((self.n, self.p))
        np.subtract(
            self._torque_regressor(q, 0.5 * (v + w), 0.5 * bracket(self.group, v, w)),
            self._torque_regressor(q, 0.5 * (v - w), self._zero),
            out=W[:, : self._links],
        )
        return W

    def _transport(self, q: Array, v: Array) -> Array:
        W = np.zeros((self.n, self.p))
        step = difference_step(v)
        ahead = self._torque_regressor(self.integrate(q, step * v), self._zero, v).copy()
        behind = self._torque_regressor(self.integrate(q, -step * v), self._zero, v)
        W[:, : self._links] = (ahead - behind) / (2 * step)
        W[:, : self._links] -= self._torque_regressor(q, v, self._zero)  # of C v: rotors have none
        return W

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        F = self._joint_forces(q, v, u)
        weight = self._weighted(q, self._zero, self._zero)
        np.negative(weight, out=F[:, : self._links])
        return F

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        W = -self._joint_forces(q, v, u)
        turned = a + 0.5 * bracket(self.group, v, w)
        np.subtract(
            self._weighted(q, 0.5 * (v + w), turned),
            self._torque_regressor(q, 0.5 * (v - w), self._zero),
            out=W[:, : self._links],
        )
        if self._rotor is not None:
            W[self._moved, self._rotor + self._joint] = a[self.group :]
        return W

    def _joint_forces(self, q: Array, v: Array, u: Array) -> Array:
        """(n, p) columns of friction and actuators; those of the links are 0."""
        F, rate = np.zeros((self.n, self.p)), v[self.group :]
        F[self._moved, self._viscous + self._joint] = -rate
        F[self._moved, self._coulomb + self._joint] = -np.tanh(rate / self.friction_speed)
        servos = self.scales.actuator == "servo"
        pushes = u - self.angles(q)[self.driven] if servos else u
        F[self._moved[self.driven], self._gain + np.arange(self.n_u)] = pushes
        return F

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """â of (29), W of (10, 31) and M̂'s smallest pivot at one sample.

        W is Pinocchio's. â is the structure's, since Pinocchio's forward dynamics store centres of
        mass h/m and so cannot handle massless links.
        """
        a_hat, pivot = self._own.acceleration(plain(q), plain(v), plain(u), plain(w), plain(theta))
        W = self._W(t, q, v, w, a_hat if pivot > 0 else self._zero, u)
        return Stage(a_hat, W, pivot)

    # -- along a log ---------------------------------------------------------------------------

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples."""
        return forces_by_sample(self, t, q, v, u)

    def motion(self, log: Log, hermite: bool) -> RegressorMotion:
        """The robot's motion along a log, with the links' entries of Wᵀ Δv from Pinocchio.

        Only one thread at a time may follow it: its stages pass through the same three arrays.
        """
        own, qm = self._own_motion(log, hermite)
        qs, vs, vm = log.q, own.v, own.vm
        v_hat, a_hat, leading = np.empty(self.n), np.empty(self.n), np.empty(self._links)
        heavy, light = self.model.createData(), self._weightless.createData()
        torques = pin.computeJointTorqueRegressor

        def write(at: int, k: int) -> None:
            leading.fill(np.nan)  # in case Pinocchio raises: an exception ends here
            row = k - 1 + at // 2
            q, v = (qm[k - 1], vm[k - 1]) if at == 1 else (qs[row], vs[row])
            a = a_hat + 0.5 * bracket(self.group, v, v_hat) if self.group else a_hat
            dv = v_hat - v  # (37)
            weighted = torques(self.model, heavy, q, 0.5 * (v + v_hat), a)
            turning = torques(self._weightless, light, q, 0.5 * dv, self._zero)
            np.subtract(dv @ np.atleast_2d(weighted), dv @ np.atleast_2d(turning), out=leading)

        function = _REGRESSOR(write)
        weakref.finalize(own.states, bool, function)  # it lives as long as the motion
        address = ctypes.cast(function, ctypes.c_void_p).value
        assert address is not None
        return RegressorMotion(own.t, own.v, own.vm, own, v_hat, a_hat, leading, address)

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance, sample by sample."""
        return balance_by_sample(self, leak, log, q, v)


def link_block(number: int, name: str, mass: float, length: float) -> Block:
    """The ten inertial parameters of a body.

    Args:
        number: of the body; 0 is a floating base.
        name: of its link.
        mass: guess [kg].
        length: guess of its size [m].
    """
    return Block(
        f"link {number}" if number else "base",
        tuple(f"{name}_{number}" for name in INERTIAL),
        INERTIAL_UNITS,
        mass * np.repeat([1.0, length, length**2], [1, 3, 6]),
        "pseudo_inertia",
        labels=inertial_labels(name),
    )


def joint_block(
    name: str,
    letter: str,
    units: tuple[str, str],
    model: pin.Model,
    scale: Array,
    actuator: bool = False,
    driven: Sequence[int] | None = None,
) -> Block:
    """A block of one positive parameter per joint; `units` for revolute and prismatic joints."""
    sliding, names = [slides(joint) for joint in moving_joints(model)], joint_names(model)
    own = range(len(names)) if driven is None else driven
    return Block(
        name,
        tuple(f"{letter}_{i + 1}" for i in own),
        tuple(units[sliding[i]] for i in own),
        scale,
        "positive",
        actuator,
        labels=tuple(f"{name.removeprefix('motor ')} of {names[i]}" for i in own),
    )


def joint_blocks(model: pin.Model, s: JointScales) -> list[Block]:
    """Blocks of the joints, if any: rotor inertia if modelled, friction, motor gain."""
    blocks = []
    if s.rotor is not None:
        blocks.append(joint_block("rotor inertia", "rotor", ("kg·m²", "kg"), model, s.rotor))
    for name, letter, units, scale in (
        ("viscous friction", "viscous", ("N·m·s/rad", "N·s/m"), s.viscous),
        ("Coulomb friction", "coulomb", ("N·m", "N"), s.coulomb),
    ):
        blocks.append(joint_block(name, letter, units, model, scale))
    blocks.append(joint_block(*_ACTUATORS[s.actuator], model, s.gain, True, s.driven))
    return blocks if moving_joints(model) else []


def link_blocks(model: pin.Model, s: JointScales) -> list[Block]:
    """The inertial parameters of every body; a floating base is number 0."""
    guesses = zip(body_names(model), s.mass, s.length, strict=True)
    first = 0 if floats(model) else 1
    return [link_block(first + i, name, mass, size) for i, (name, mass, size) in enumerate(guesses)]


def _space(model: pin.Model, s: JointScales) -> ParameterSpace:
    return ParameterSpace((*link_blocks(model, s), *joint_blocks(model, s)))
