"""Trees of joints as in `multibody`, with the structure's regressors."""

from __future__ import annotations

import numpy as np

from ..errors import EnginesDisagree
from ..parameters import Array
from .multibody import JointScales, MotorTree
from .optional import pin
from .structured import StructuredSystem

AGREEMENT = 1e-10
"""Largest accepted difference from Pinocchio, relative to the largest entry."""

_SAMPLES = 20  # random states at which both are compared


class CompiledMultibody(MotorTree, StructuredSystem):
    """A `MotorTree` whose regressors are the structure's: Pinocchio's numbers, much faster.

    They are compared with Pinocchio's `computeJointTorqueRegressor`, `crba` and
    `nonLinearEffects` when the system is made.

    Args:
        model: kinematics and gravity; its inertias are discarded.
        scales: data-sheet guesses, which become the scale of θ.
        friction_speed: (k,) joint speed at which Coulomb friction saturates [rad/s or m/s].

    Raises:
        EnginesDisagree: the structure and Pinocchio differ by more than `AGREEMENT`.
    """

    def __init__(self, model: pin.Model, scales: JointScales, friction_speed: Array):
        super().__init__(model, scales, friction_speed)
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
