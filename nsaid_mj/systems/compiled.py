"""Trees of joints as in `multibody`, with the compiled regressors of `dynamics.tree_regressor`."""

from __future__ import annotations

import numpy as np

from ..dynamics.motions import TreeMotion, tree_motion
from ..dynamics.tree_regressor import (
    tree_balance,
    tree_evaluate,
    tree_forces,
    tree_inertial,
    tree_mass_tensor,
    tree_regressor,
    tree_transport,
)
from ..errors import EnginesDisagree
from ..log import Log
from ..parameters import Array
from ..system import Stage
from .general import forces_by_sample
from .multibody import JointScales, MotorTree
from .optional import pin

AGREEMENT = 1e-10
"""Largest accepted difference from Pinocchio, relative to the largest entry."""

_SAMPLES = 20  # random states at which both are compared


class CompiledMultibody(MotorTree):
    """A `MotorTree` whose regressors are compiled recursions: Pinocchio's numbers, much faster.

    The kernels use the tree of the Pinocchio model, and are compared with Pinocchio's
    `computeJointTorqueRegressor`, `crba` and `nonLinearEffects` when the system is made.

    Args:
        model: kinematics and gravity; its inertias are discarded.
        scales: data-sheet guesses, which become the scale of θ.
        friction_speed: (k,) joint speed at which Coulomb friction saturates [rad/s or m/s].

    Raises:
        EnginesDisagree: the recursions and Pinocchio differ by more than `AGREEMENT`.
    """

    def __init__(self, model: pin.Model, scales: JointScales, friction_speed: Array):
        super().__init__(model, scales, friction_speed)
        self.forward = self.tree
        check_consistency(self)

    def _W_M(self, q: Array, a: Array) -> Array:
        return tree_inertial(self.tree, q, self._zero, self._zero, a, self.p)

    def _mass_tensor(self, q: Array) -> Array:
        return tree_mass_tensor(self.tree, q, self.n, self.p)

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        return tree_inertial(self.tree, q, v, w, self._zero, self.p)

    def _transport(self, q: Array, v: Array) -> Array:
        return tree_transport(self.tree, q, v, self.p)

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        return tree_forces(self.tree, q, v, u, self.p)

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return tree_regressor(self.tree, q, v, w, a, u, self.p)

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """The acceleration (29), the regressor (10, 31) and M̂'s smallest pivot at one sample."""
        return Stage(*tree_evaluate(self.tree, q, v, u, w, np.ascontiguousarray(theta)))

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples."""
        return forces_by_sample(self, t, q, v, u)

    def motion(self, log: Log, hermite: bool) -> TreeMotion:
        """The tree's motion along a log."""
        return tree_motion(self.tree, hermite, *log)

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance, in one pass over the bodies."""
        return tree_balance(self.tree, leak, *log[1:], q, v, self.p)


def check_consistency(system: MotorTree) -> None:
    """Compares the compiled recursions of a tree with Pinocchio at random states.

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
    still, unit = np.zeros(system.n), np.eye(system.n)
    for _ in range(_SAMPLES):
        q, v, _ = system.random_state(rng)
        a, u = rng.uniform(-1, 1, system.n), np.zeros(system.n_u)
        regressor = pin.computeJointTorqueRegressor(model, data, q, v, a)
        mass = pin.crba(model, data, q)
        bias = pin.nonLinearEffects(model, data, q, v)
        ours = tree_regressor(system.tree, q, v, v, a, u, system.p)[:, :links]
        columns = [tree_inertial(system.tree, q, still, still, e, system.p) @ theta for e in unit]
        ours_bias = tree_regressor(system.tree, q, v, v, still, u, system.p)[:, :links]
        for quantity, own, theirs in (
            ("torque regressor", ours, regressor.reshape(system.n, links)),
            ("mass matrix", np.array(columns), np.triu(mass) + np.triu(mass, 1).T),
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
                    ("The compiled recursions", "Pinocchio"),
                    "Take --backend pinocchio.",
                )
