"""The regressors of a tree's links by Pinocchio: the reference of the structure's, and slower."""

from __future__ import annotations

import ctypes
import weakref
from typing import Any

import numpy as np

from ...base import pin
from ..log import Log
from ..numerics.spatial import bracket
from ..parameters import Array
from .motion import Motion, Outside

DIFFERENCE = 1e-5
"""Step of central differences along v [s·(1 + |v|)]."""
_REGRESSOR = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)


class PinocchioLinks:
    """The regressors of a tree's links by Pinocchio.

    `system` is a `JointTree`, which imports this module.
    """

    def __init__(self, system: Any):
        self._system = system
        self._links = 10 * system.bodies
        light = pin.Model(system.model)
        light.gravity.setZero()
        self._heavy, self._weightless = ((own, own.createData()) for own in (system.model, light))

    def _torques(self, q: Array, v: Array, a: Array, heavy: float = 0.0) -> Array:
        """(n, 10 b) Pinocchio's regressor, with gravity if `heavy`; the next call overwrites it."""
        model, data = self._heavy if heavy else self._weightless
        return np.atleast_2d(pin.computeJointTorqueRegressor(model, data, q, v, a))

    def overwrite(self, W: Array, q: Array, v: Array, w: Array, a: Array, weight: float) -> None:
        """Overwrites the links' columns of W (N, n, p); see `SecondOrderSystem._regressors`."""
        for k, rows in enumerate(W):
            turning = 0.5 * bracket(self._system.group, v[k], w[k])
            rows[:, : self._links] = self._torques(
                q[k], 0.5 * (v[k] + w[k]), a[k] + turning, weight
            )
            rows[:, : self._links] -= self._torques(q[k], 0.5 * (v[k] - w[k]), self._system._still)

    def transport(self, q: Array, v: Array) -> Array:
        """(n, p) regressor of Ṁ v − C v, with Ṁ v by central differences."""
        system = self._system
        step = DIFFERENCE / (1.0 + float(np.abs(v).max(initial=0.0)))  # Ṁ v to about 1e-10
        ahead = system.integrate(q, step * v)
        behind = system.integrate(q, -step * v)
        return (system._W_M(ahead, v) - system._W_M(behind, v)) / (2 * step) - system._W_C(q, v, v)

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance, sample by sample."""
        system = self._system
        t = log.t
        held = log.u[:-1]
        momenta = np.stack([system._W_M(*row) for row in zip(log.q, log.v, strict=True)])
        drive = leak * momenta
        drive += np.stack([self.transport(*row) for row in zip(log.q, log.v, strict=True)])
        half = system.forces(t[:-1], q, v, held)
        half += np.stack(
            [leak * system._W_M(*row) + self.transport(*row) for row in zip(q, v, strict=True)]
        )
        start = drive[:-1] + system.forces(t[:-1], log.q[:-1], log.v[:-1], held)
        end = drive[1:] + system.forces(t[1:], log.q[1:], log.v[1:], held)
        return momenta, start, half, end

    def motion(self, own: Motion, qs: Array, qm: Array) -> Motion:
        """The structure's own motion, with the links' entries of Wᵀ Δv from Pinocchio.

        Only one thread at a time may follow it: its stages pass through the same three arrays.
        Positions are (N, m) at the samples and (N−1, m) half-way.
        """
        system = self._system
        vs = own.v
        vm = own.vm
        v_hat = np.empty(system.n)
        a_hat = np.empty(system.n)
        leading = np.empty(self._links)
        models = system.model, self._weightless[0]
        own_data = models[0].createData(), models[1].createData()
        torques = pin.computeJointTorqueRegressor

        def write(at: int, k: int) -> None:
            leading.fill(np.nan)  # in case Pinocchio raises: an exception ends here
            row = k - 1 + at // 2
            q, v = (qm[k - 1], vm[k - 1]) if at == 1 else (qs[row], vs[row])
            a = a_hat + 0.5 * bracket(system.group, v, v_hat) if system.group else a_hat
            dv = v_hat - v  # (37)
            weighted = torques(models[0], own_data[0], q, 0.5 * (v + v_hat), a)
            turning = torques(models[1], own_data[1], q, 0.5 * dv, system._still)
            np.subtract(dv @ np.atleast_2d(weighted), dv @ np.atleast_2d(turning), out=leading)

        function = _REGRESSOR(write)
        weakref.finalize(own.states, bool, function)  # keeps it alive as long as the motion
        address = ctypes.cast(function, ctypes.c_void_p).value
        assert address is not None
        return own._replace(outside=Outside(address, v_hat, a_hat, leading))
