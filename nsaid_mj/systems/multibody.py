"""Trees of revolute and prismatic joints (5), fixed or afloat, through Pinocchio's regressors.

θ = ten inertial parameters of every link, the base first where it floats, then, for every joint,
rotor inertia (where the robot has any), viscous and Coulomb friction, motor gain. Link inertias are
about the joint-frame origin in joint axes, in Pinocchio's order: m, m·c (3), Ixx, Ixy, Iyy, Ixz,
Iyz, Izz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numba import njit

from ..dynamics.tree import accelerate, tree_state, tree_work
from ..numerics.spatial import bracket
from ..parameters import Array, Block, ParameterSpace
from ..system import DIFFERENCE, Instant
from .joints import JointTree
from .rigid_body import INERTIAL, INERTIAL_UNITS, inertial_labels
from .tree import linkage_of

_BASE_SPEED = 1.0  # a base that floats is probed at up to this [m/s, rad/s]


@dataclass(frozen=True)
class JointScales:
    """What a data sheet tells of a robot: one guess for each of its b bodies and k joints.

    Attributes:
        mass: (b,) masses of the bodies, the base first where it floats [kg].
        length: (b,) sizes of the bodies [m].
        viscous: (k,) viscous friction [N·m·s/rad or N·s/m].
        coulomb: (k,) Coulomb friction [N·m or N].
        gain: (k,) motor gains [N·m or N per unit of command].
        speed: (k,) speeds of operation [rad/s or m/s].
        command: (k,) commands of operation [units of command].
        rotor: (k,) reflected rotor inertias [kg·m² or kg]; None leaves them out of θ.
    """

    mass: Array
    length: Array
    viscous: Array
    coulomb: Array
    gain: Array
    speed: Array
    command: Array
    rotor: Array | None = None


class Multibody(JointTree):
    """M(q, θ) v̇ + C(x, θ) v = −g(q, θ) − f(v, θ) + diag(k) u (5), with motors on the joints only.

    C is Pinocchio's: with R_g and R_0 the joint torque regressors with and without gravity,
    C(q, v) w = R_0(q, (v+w)/2, ½[v, w]) π − R_0(q, (v−w)/2, 0) π, whose Ṁ − 2C is skew. [v, w] is
    the Lie bracket of the base's twists, 0 where the base is fixed: rates of joints commute.
    Friction is `viscous·v + coulomb·tanh(v/friction_speed)`.

    Args:
        model: kinematics and gravity; its inertias are not read and not kept.
        scales: data-sheet guesses, which become the scale of θ.
        friction_speed: (k,) joint speed at which Coulomb friction is developed [rad/s or m/s].

    Attributes:
        tree: its bodies, for `recursion`.
    """

    def __init__(self, model: pin.Model, scales: JointScales, friction_speed: Array):
        super().__init__(model)
        self._weightless = pin.Model(self.model)
        self._weightless.gravity.setZero()
        self._data, self._data_0 = self.model.createData(), self._weightless.createData()
        self.n_u = len(self.joints)
        self.scales, self.friction_speed = scales, np.asarray(friction_speed, dtype=np.float64)
        self.space = _space(self, scales)
        self._links = 10 * self.bodies
        self._zero = np.zeros(self.n)
        self._unit = np.eye(self.n)
        self._joint = np.arange(self.n_u)
        self._moved = self.group + self._joint  # the velocity of each joint
        rotors = 0 if scales.rotor is None else self.n_u
        self._rotor = self._links if rotors else None
        self._viscous = self._links + rotors
        self._coulomb, self._gain = self._viscous + self.n_u, self._viscous + 2 * self.n_u
        self._at = (
            self.group,
            -1 if self._rotor is None else self._rotor,
            self._viscous,
            self._coulomb,
            self._gain,
        )
        columns = np.array([self._links, self._viscous, self._coulomb, self._gain])
        self.tree = linkage_of(self.model, self.friction_speed, columns)
        self._speed = np.concatenate([np.full(self.group, _BASE_SPEED), scales.speed])

    # -- regressors ----------------------------------------------------------------------------

    def _torque_regressor(self, q: Array, v: Array, a: Array) -> Array:
        """(n, 10 n) of a robot without weight."""
        return pin.computeJointTorqueRegressor(self._weightless, self._data_0, q, v, a)

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
        step = DIFFERENCE / (1.0 + np.abs(v).max(initial=0.0))
        ahead = self._torque_regressor(self.integrate(q, step * v), self._zero, v).copy()
        behind = self._torque_regressor(self.integrate(q, -step * v), self._zero, v)
        W[:, : self._links] = (ahead - behind) / (2 * step)
        W[:, : self._links] -= self._torque_regressor(q, v, self._zero)  # of C v: rotors have none
        return W

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        F = self._joint_forces(v, u)
        weight = pin.computeJointTorqueRegressor(self.model, self._data, q, self._zero, self._zero)
        np.negative(weight, out=F[:, : self._links])
        return F

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        W = -self._joint_forces(v, u)
        turned = a + 0.5 * bracket(self.group, v, w)
        np.subtract(
            pin.computeJointTorqueRegressor(self.model, self._data, q, 0.5 * (v + w), turned),
            self._torque_regressor(q, 0.5 * (v - w), self._zero),
            out=W[:, : self._links],
        )
        if self._rotor is not None:
            W[self._moved, self._rotor + self._joint] = a[self.group :]
        return W

    def _joint_forces(self, v: Array, u: Array) -> Array:
        """(n, p) columns of friction and motors; those of the links are 0."""
        F, rate = np.zeros((self.n, self.p)), v[self.group :]
        F[self._moved, self._viscous + self._joint] = -rate
        F[self._moved, self._coulomb + self._joint] = -np.tanh(rate / self.friction_speed)
        F[self._moved, self._gain + self._joint] = u
        return F

    def at(self, t: float, q: Array, v: Array, u: Array) -> Instant:
        """The robot at one measured state and command."""
        if self.n == 1:  # Pinocchio squeezes a single joint's matrices to vectors
            return Instant(self, t, q, v, u)
        return _TreeInstant(self, t, q, v, u)

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        return q, v, self.scales.command * rng.uniform(-1, 1, self.n_u)


class _TreeInstant(Instant):
    """A robot at one state: W is Pinocchio's; â solves the same equations by `recursion`.

    Pinocchio's own algorithms for â store centres of mass, h/m, and so refuse links without mass.
    """

    system: Multibody

    def evaluate(self, w: Array, theta: Array) -> tuple[Array, Array, float]:
        """As in the base class."""
        tree, q, v, u = self.system, self.q, self.v, self.u
        theta = np.ascontiguousarray(theta)
        a_hat, plus, minus, turned, pivot = _accelerate(tree.tree, tree.group, q, v, w, u, theta)
        W = _whole(
            pin.computeJointTorqueRegressor(tree.model, tree._data, q, plus, turned),
            pin.computeJointTorqueRegressor(tree._weightless, tree._data_0, q, minus, tree._zero),
            v, a_hat, u, tree.friction_speed, tree._at, tree.p,
        )  # fmt: skip
        if not pivot > 0:
            a_hat[:] = np.nan
        return a_hat, W, pivot

    def commanded(self, t: float, u: Array) -> Instant:
        """The same state under another command."""
        return _TreeInstant(self.system, t, self.q, self.v, u)


@njit(cache=True)
def _accelerate(tree, group, q, v, w, u, theta):
    """â of (29), 0 where M̂ is not ≻ 0; (v + w)/2; (v − w)/2; â + ½[v, w]; M̂'s smallest pivot."""
    a = np.empty(v.shape[0])
    state = tree_state(tree, q, v)
    pivot = accelerate(tree, state, v, w, u, theta, tree_work(tree, v.shape[0]), a)
    if not pivot > 0.0:
        a[:] = 0.0
    return a, 0.5 * (v + w), 0.5 * (v - w), a + 0.5 * bracket(group, v, w), pivot


@njit(cache=True)
def _whole(with_weight, without, v, a, u, friction_speed, at, p):
    """(n, p) W of (10) from the two regressors of its links."""
    n, links = with_weight.shape
    base, rotor, viscous, coulomb, gain = at
    W = np.zeros((n, p))
    for i in range(n):
        for k in range(links):
            W[i, k] = with_weight[i, k] - without[i, k]
    for k in range(n - base):
        i = base + k
        W[i, viscous + k] = v[i]
        W[i, coulomb + k] = np.tanh(v[i] / friction_speed[k])
        W[i, gain + k] = -u[k]
        if rotor >= 0:
            W[i, rotor + k] = a[i]
    return W


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
    tree: JointTree,
    scale: Array,
    actuator: bool = False,
) -> Block:
    """One positive parameter for each joint; `units` of turning and of sliding ones."""
    return Block(
        name,
        tuple(f"{letter}_{i + 1}" for i in range(len(tree.slides))),
        tuple(units[sliding] for sliding in tree.slides),
        scale,
        "positive",
        actuator,
        labels=tuple(f"{name.removeprefix('motor ')} of {joint}" for joint in tree.joint_names),
    )


def joint_blocks(tree: JointTree, s: JointScales) -> list[Block]:
    """Rotor inertia where there is any, friction and motor gain of joints, if there are joints."""
    blocks = []
    if s.rotor is not None:
        blocks.append(joint_block("rotor inertia", "rotor", ("kg·m²", "kg"), tree, s.rotor))
    for name, letter, units, scale, actuator in (
        ("viscous friction", "viscous", ("N·m·s/rad", "N·s/m"), s.viscous, False),
        ("Coulomb friction", "coulomb", ("N·m", "N"), s.coulomb, False),
        ("motor gain", "gain", ("N·m/unit", "N/unit"), s.gain, True),
    ):
        blocks.append(joint_block(name, letter, units, tree, scale, actuator=actuator))
    return blocks if tree.joints else []


def _space(tree: JointTree, s: JointScales) -> ParameterSpace:
    first = 0 if tree.group else 1
    links = [
        link_block(first + i, tree.body_names[i], s.mass[i], s.length[i])
        for i in range(tree.bodies)
    ]
    return ParameterSpace((*links, *joint_blocks(tree, s)))
