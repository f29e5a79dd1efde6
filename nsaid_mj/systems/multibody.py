"""Fixed-base trees of revolute and prismatic joints, (5), through Pinocchio's regressors.

θ = ten inertial parameters of every link, then, for every joint, rotor inertia (where the robot
has any), viscous and Coulomb friction, motor gain. Link inertias are about the joint-frame origin
in joint axes, in Pinocchio's order: m, m·c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numba import njit

from ..kernels import cholesky, solve
from ..parameters import Array, Block, ParameterSpace
from ..system import Instant, SecondOrderSystem

INERTIAL = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_INERTIAL_UNITS = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6
_UNLIMITED = np.pi  # a joint without limits is probed over one turn, or this many metres


@dataclass(frozen=True)
class JointScales:
    """What a data sheet tells of an arm: one guess for each link and joint.

    Attributes:
        mass: (n,) link masses [kg].
        length: (n,) sizes of the links [m].
        viscous: (n,) viscous friction [N·m·s/rad or N·s/m].
        coulomb: (n,) Coulomb friction [N·m or N].
        gain: (n,) motor gains [N·m or N per unit of command].
        speed: (n,) speeds of operation [rad/s or m/s].
        command: (n,) commands of operation [units of command].
        rotor: (n,) reflected rotor inertias [kg·m² or kg]; None leaves them out of θ.
    """

    mass: Array
    length: Array
    viscous: Array
    coulomb: Array
    gain: Array
    speed: Array
    command: Array
    rotor: Array | None = None


class Multibody(SecondOrderSystem):
    """M(q, θ) v̇ + C(x, θ) v = −g(q, θ) − f(v, θ) + diag(k) u (5).

    C is Pinocchio's: with R_g and R_0 the joint torque regressors with and without gravity,
    C(q, v) w = R_0(q, (v+w)/2, 0) π − R_0(q, (v−w)/2, 0) π, whose Ṁ − 2C is skew.
    Friction is `viscous·v + coulomb·tanh(v/friction_speed)`.

    Args:
        model: kinematics and gravity; its inertias are not read and not kept.
        scales: data-sheet guesses, which become the scale of θ.
        friction_speed: (n,) joint speed at which Coulomb friction is developed [rad/s or m/s].
    """

    def __init__(self, model: pin.Model, scales: JointScales, friction_speed: Array):
        self.model = pin.Model(model)
        for i in range(self.model.njoints):
            self.model.inertias[i] = pin.Inertia.Zero()  # structure only: no true value in here
        self.model.armature[:] = 0.0
        self._weightless = pin.Model(self.model)
        self._weightless.gravity.setZero()
        self._data, self._data_0 = self.model.createData(), self._weightless.createData()
        self.n, self.m, self.n_u = self.model.nv, self.model.nq, self.model.nv
        self.scales, self.friction_speed = scales, np.asarray(friction_speed, dtype=np.float64)
        self.space = _space(self.model, scales)
        self._links = 10 * self.n
        self._zero = np.zeros(self.n)
        self._unit = np.eye(self.n)
        self._joint = np.arange(self.n)
        self._rotor = self.space["rotor inertia"].start if scales.rotor is not None else None
        self._viscous = self.space["viscous friction"].start
        self._coulomb = self.space["Coulomb friction"].start
        self._gain = self.space["motor gain"].start
        self._at = (
            -1 if self._rotor is None else self._rotor,
            self._viscous,
            self._coulomb,
            self._gain,
        )
        self._smallest_mass = 1e-6 * scales.mass
        self._parents = np.array([parent - 1 for parent in list(self.model.parents)[1:]])
        self._plain = self.m == self.n  # no continuous joint: positions add

    # -- regressors ----------------------------------------------------------------------------

    def _torque_regressor(self, q: Array, v: Array, a: Array) -> Array:
        """(n, 10 n) of a robot without weight."""
        return pin.computeJointTorqueRegressor(self._weightless, self._data_0, q, v, a)

    def _W_M(self, q: Array, a: Array) -> Array:
        W = np.zeros((self.n, self.p))
        W[:, : self._links] = self._torque_regressor(q, self._zero, a)
        if self._rotor is not None:
            W[self._joint, self._rotor + self._joint] = a
        return W

    def _mass_tensor(self, q: Array) -> Array:
        tensor = np.zeros((self.n, self.n, self.p))
        for j in range(self.n):
            tensor[j, :, : self._links] = self._torque_regressor(q, self._zero, self._unit[j])
        if self._rotor is not None:
            tensor[self._joint, self._joint, self._rotor + self._joint] = 1.0
        return tensor

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        W = np.zeros((self.n, self.p))
        np.subtract(
            self._torque_regressor(q, 0.5 * (v + w), self._zero),
            self._torque_regressor(q, 0.5 * (v - w), self._zero),
            out=W[:, : self._links],
        )
        return W

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        F = self._joint_forces(v, u)
        weight = pin.computeJointTorqueRegressor(self.model, self._data, q, self._zero, self._zero)
        np.negative(weight, out=F[:, : self._links])
        return F

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        W = -self._joint_forces(v, u)
        np.subtract(
            pin.computeJointTorqueRegressor(self.model, self._data, q, 0.5 * (v + w), a),
            self._torque_regressor(q, 0.5 * (v - w), self._zero),
            out=W[:, : self._links],
        )
        if self._rotor is not None:
            W[self._joint, self._rotor + self._joint] = a
        return W

    def _joint_forces(self, v: Array, u: Array) -> Array:
        """(n, p) columns of friction and motors; those of the links are 0."""
        F = np.zeros((self.n, self.p))
        F[self._joint, self._viscous + self._joint] = -v
        F[self._joint, self._coulomb + self._joint] = -np.tanh(v / self.friction_speed)
        F[self._joint, self._gain + self._joint] = u
        return F

    def at(self, t: float, q: Array, v: Array, u: Array) -> Instant:
        """The arm at one measured state and command."""
        if self.n == 1:  # Pinocchio squeezes a single joint's matrices to vectors
            return Instant(self, t, q, v, u)
        return _ArmInstant(self, t, q, v, u)

    # -- kinematics ----------------------------------------------------------------------------

    def integrate(self, q: Array, dq: Array) -> Array:
        """q ⊕ dq; continuous joints stay on the unit circle."""
        return q + dq if self._plain else pin.integrate(self.model, q, dq)

    def difference(self, q0: Array, q1: Array) -> Array:
        """q1 ⊖ q0; for continuous joints the short way round."""
        return q1 - q0 if self._plain else pin.difference(self.model, q0, q1)

    def J(self, q: Array) -> Array:
        """(m, n) with q̇ = J v (3): 1 for a joint's number, (−sin, cos) for a continuous joint."""
        J = np.zeros((self.m, self.n))
        for joint in list(self.model.joints)[1:]:
            if joint.nq == 2:
                J[joint.idx_q : joint.idx_q + 2, joint.idx_v] = -q[joint.idx_q + 1], q[joint.idx_q]
            else:
                J[joint.idx_q, joint.idx_v] = 1.0
        return J

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """(n,), (n,) joint range; one turn about zero where the model states none."""
        low, high = -_UNLIMITED * np.ones(self.n), _UNLIMITED * np.ones(self.n)
        for joint in list(self.model.joints)[1:]:
            if joint.nq == 1:
                a = self.model.lowerPositionLimit[joint.idx_q]
                b = self.model.upperPositionLimit[joint.idx_q]
                if np.isfinite([a, b]).all() and a < b:
                    low[joint.idx_v], high[joint.idx_v] = max(a, -10.0), min(b, 10.0)
        return low, high

    def position(self, coordinates: Array) -> Array:
        """(..., m) position q of one number for each joint (..., n): angle [rad] or travel [m]."""
        if self._plain:
            return np.array(coordinates, dtype=np.float64)
        coordinates = np.asarray(coordinates, dtype=np.float64)
        q = np.zeros((*coordinates.shape[:-1], self.m))
        for joint in list(self.model.joints)[1:]:
            c = coordinates[..., joint.idx_v]
            if joint.nq == 2:
                q[..., joint.idx_q], q[..., joint.idx_q + 1] = np.cos(c), np.sin(c)
            else:
                q[..., joint.idx_q] = c
        return q

    @cached_property
    def velocity_units(self) -> tuple[str, ...]:
        """One unit for each velocity: rad/s, or m/s for a prismatic joint."""
        return tuple("m/s" if slides else "rad/s" for slides in _slides(self.model))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self.scales.speed * rng.uniform(-1, 1, self.n)
        return q, v, self.scales.command * rng.uniform(-1, 1, self.n)


class _ArmInstant(Instant):
    """An arm at one state: M(q, θ̂) by the composite rigid body algorithm under θ̂'s inertias.

    That is four times cheaper than n regressors, but Pinocchio stores centres of mass, h/m, and
    adds inertias by dividing by the sum of their masses: where a link's mass is near 0, or what
    a joint carries is not heavier than 0, the base class's regressors take over.
    """

    system: Multibody

    def evaluate(self, w: Array, theta: Array) -> tuple[Array, Array, float]:
        """As in the base class."""
        arm, q, v, zero = self.system, self.q, self.v, self.system._zero
        massive, plus, minus = _prepare(v, w, theta, arm._smallest_mass, arm._parents)
        if not massive:
            return super().evaluate(w, theta)
        model, data, weightless, data_0 = arm.model, arm._data, arm._weightless, arm._data_0
        regressor, inertias = pin.computeJointTorqueRegressor, model.inertias
        for i in range(arm.n):
            inertias[i + 1] = pin.Inertia.FromDynamicParameters(theta[10 * i : 10 * i + 10])
        a_hat, W, pivot = _accelerate(
            pin.crba(model, data, q),
            regressor(model, data, q, plus, zero),
            regressor(weightless, data_0, q, minus, zero),
            v, arm.friction_speed, self.u, theta, arm._at,
        )  # fmt: skip
        if pivot > 0:
            _accelerated(W, regressor(weightless, data_0, q, zero, a_hat), a_hat, arm._at)
        return a_hat, W, pivot

    def commanded(self, t: float, u: Array) -> Instant:
        """The same state under another command."""
        return _ArmInstant(self.system, t, self.q, self.v, u)


@njit(cache=True)
def _prepare(v, w, theta, smallest, parents):
    """Whether all masses are fit for Pinocchio's inertias; (v + w)/2; (v − w)/2.

    Fit is: no link is within ±smallest (n,) of 0, and no joint carries less than its smallest.
    """
    n = smallest.shape[0]
    carried = theta[: 10 * n : 10].copy()
    for i in range(n - 1, -1, -1):
        if not (abs(theta[10 * i]) >= smallest[i] and carried[i] >= smallest[i]):
            return False, v, w
        if parents[i] >= 0:
            carried[parents[i]] += carried[i]
    return True, 0.5 * (v + w), 0.5 * (v - w)


@njit(cache=True)
def _accelerate(M, with_weight, without, v, friction_speed, u, theta, at):
    """â of (29), W_C − F, and M̂'s smallest pivot; `M` is Pinocchio's upper triangle of links."""
    n, links = with_weight.shape
    rotor, viscous, coulomb, gain = at
    W = np.zeros((n, theta.shape[0]))
    L, M_hat = np.zeros((n, n)), np.empty((n, n))
    for i in range(n):
        for k in range(links):
            W[i, k] = with_weight[i, k] - without[i, k]
        W[i, viscous + i] = v[i]
        W[i, coulomb + i] = np.tanh(v[i] / friction_speed[i])
        W[i, gain + i] = -u[i]
        for j in range(i + 1):
            M_hat[i, j] = M[j, i]
        if rotor >= 0:
            M_hat[i, i] += theta[rotor + i]
    pivot = cholesky(M_hat, L)
    if not pivot > 0.0:
        return np.full(n, np.nan), W, pivot
    return solve(L, -np.dot(W, theta)), W, pivot


@njit(cache=True)
def _accelerated(W, W_M, a, at):
    """Adds W_M(x, a) to W in place."""
    n, links = W_M.shape
    for i in range(n):
        for k in range(links):
            W[i, k] += W_M[i, k]
        if at[0] >= 0:
            W[i, at[0] + i] += a[i]


def _slides(model: pin.Model) -> list[bool]:
    """Which joints are prismatic."""
    return [joint.shortname().startswith("JointModelP") for joint in list(model.joints)[1:]]


def _space(model: pin.Model, s: JointScales) -> ParameterSpace:
    joints = range(1, model.njoints)
    links = [
        Block(
            f"link {i}",
            tuple(f"{name}_{i}" for name in INERTIAL),
            _INERTIAL_UNITS,
            s.mass[i - 1] * np.repeat([1.0, s.length[i - 1], s.length[i - 1] ** 2], [1, 3, 6]),
            "pseudo_inertia",
        )
        for i in joints
    ]
    slides = _slides(model)

    def per_joint(name: str, letter: str, turn: str, slide: str, scale: Array, actuator=False):
        units = tuple(slide if sliding else turn for sliding in slides)
        return Block(
            name, tuple(f"{letter}_{i}" for i in joints), units, scale, "positive", actuator
        )

    blocks = list(links)
    if s.rotor is not None:
        blocks.append(per_joint("rotor inertia", "rotor", "kg·m²", "kg", s.rotor))
    blocks.append(per_joint("viscous friction", "viscous", "N·m·s/rad", "N·s/m", s.viscous))
    blocks.append(per_joint("Coulomb friction", "coulomb", "N·m", "N", s.coulomb))
    blocks.append(per_joint("motor gain", "gain", "N·m/unit", "N/unit", s.gain, actuator=True))
    return ParameterSpace(tuple(blocks))
