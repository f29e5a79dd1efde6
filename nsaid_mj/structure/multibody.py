"""Trees of joints with the structure's regressors, and with Pinocchio's, the reference."""

from __future__ import annotations

import ctypes
import weakref

import numpy as np

from ..errors import EnginesDisagree
from ..log import Log
from ..numerics.spatial import bracket
from ..optional import pin
from ..parameters import Array
from ..system import Stage
from .general import balance_by_sample, difference_step, forces_by_sample
from .joints import Carrier, JointScales, JointTree
from .motion_types import RegressorMotion
from .structured import StructuredSystem, plain

AGREEMENT = 1e-10
"""Largest accepted difference from Pinocchio, relative to the largest entry."""
_SAMPLES = 20  # random states at which both are compared
_REGRESSOR = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)


class CompiledMultibody(JointTree, StructuredSystem):
    """A `JointTree` whose regressors are the structure's: Pinocchio's numbers, much faster.

    Those of a robot without thrusters are compared with Pinocchio's `computeJointTorqueRegressor`,
    `crba` and `nonLinearEffects` when the system is made. Its arguments are those of `JointTree`.

    Raises:
        EnginesDisagree: the structure and Pinocchio differ by more than `AGREEMENT`.
    """

    def __init__(
        self,
        model: pin.Model,
        scales: JointScales,
        friction_speed: Array,
        carrier: Carrier | None = None,
    ):
        super().__init__(model, scales, friction_speed, carrier)
        if carrier is None:
            check_consistency(self)


def check_consistency(system: CompiledMultibody) -> None:
    """Compares the regressors of a structure with Pinocchio's at random states.

    The comparison covers the torque regressor of the links and, under random physical inertias, the
    mass matrix and the bias forces.

    Raises:
        EnginesDisagree: they differ by more than `AGREEMENT` of the largest entry.
    """
    rng, model = np.random.default_rng(0), pin.Model(system.model)
    links = 10 * system.bodies
    theta = np.zeros(system.p)
    for i in range(1, model.njoints):
        model.inertias[i] = pin.Inertia.Zero()
        model.inertias[i].mass = rng.uniform(0.5, 2.0)
        model.inertias[i].lever = rng.uniform(-0.3, 0.3, 3)
        moments = rng.uniform(0.05, 0.1, 3)
        model.inertias[i].inertia = np.diag(moments)
        theta[10 * (i - 1) : 10 * i] = model.inertias[i].toDynamicParameters()
    data = model.createData()
    still = np.zeros(system.n)
    for _ in range(_SAMPLES):
        q, v, _ = system.random_state(rng)
        a, u = rng.uniform(-1, 1, system.n), np.zeros(system.n_u)
        regressor = pin.computeJointTorqueRegressor(model, data, q, v, a)
        mass = pin.crba(model, data, q)
        bias = pin.nonLinearEffects(model, data, q, v)
        ours = system._W(0.0, q, v, v, a, u)[:, :links]
        ours_bias = system._W(0.0, q, v, v, still, u)[:, :links]
        for quantity, own, theirs in (
            ("torque regressor", ours, regressor.reshape(system.n, links)),
            ("mass matrix", system._mass_tensor(q) @ theta, np.triu(mass) + np.triu(mass, 1).T),
            ("bias force", ours_bias @ theta[:links], bias),
        ):
            apart = float(np.max(np.abs(own - theirs)) / max(np.max(np.abs(theirs)), 1e-300))
            if not apart <= AGREEMENT:
                worst = int(np.argmax(np.max(np.abs(own - theirs).reshape(system.n, -1), axis=1)))
                joint = max(j.id for j in list(model.joints)[1:] if j.idx_v <= worst)
                raise EnginesDisagree(
                    model.name,
                    f"joint {model.names[joint]}",
                    quantity,
                    apart,
                    AGREEMENT,
                    ("The compiled structure", "Pinocchio"),
                    "Take --backend pinocchio.",
                )


class Multibody(JointTree):
    """A `JointTree` whose regressors are Pinocchio's: the reference, several times slower.

    Its arguments are those of `JointTree`, without a vehicle.
    """

    def __init__(self, model: pin.Model, scales: JointScales, friction_speed: Array):
        super().__init__(model, scales, friction_speed)
        self._weightless = pin.Model(self.model)
        self._weightless.gravity.setZero()
        self._data, self._data_0 = self.model.createData(), self._weightless.createData()
        self._unit, self._zero = np.eye(self.n), np.zeros(self.n)
        self._joint, self._links = np.arange(self.n_u), 10 * self.bodies
        self._moved = self.group + self._joint  # the velocity of each joint
        self._rotor = None if scales.rotor is None else self._links
        self._viscous, self._coulomb, self._gain = self.p - self.n_u * np.array([3, 2, 1])

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
        F[self._moved, self._gain + self._joint] = u - self.angles(q) if servos else u
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
