"""A stretch of a run in one compiled call: MuJoCo's step, sensors, control law.

The arithmetic and its order match the step-by-step loop in `Plant`, bit for bit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import types

from ...numerics.kernels import kernel
from ...control.computed_torque import Tracking, computed_torque, tracking_workspace
from ...log import Log
from ...parameters import Array
from .callbacks import c_function
from .coordinates import Reading, read_coordinates, write_position
from .sensors import Errors, add_errors

_FIRST, _LAST = int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADCTRL)


_mj_step = c_function("mj_step", types.uintp, types.uintp)


class World(NamedTuple):
    """MuJoCo's model and data for compiled code; the arrays are views of mjData.

    Attributes:
        model: address of mjModel.
        data: address of mjData.
        qpos: (nq,).
        qvel: (nv,).
        ctrl: (n_u,).
        warnings: (4,) counts of bad positions, velocities, accelerations and controls.
        substeps: calls of mj_step in a time step.
    """

    model: np.uintp
    data: np.uintp
    qpos: Array
    qvel: Array
    ctrl: Array
    warnings: Any
    substeps: int

    @staticmethod
    def of(model: Any, data: Any, substeps: int) -> World:
        """Views of a model and its data, which must outlive them."""
        addresses = np.uintp(model._address), np.uintp(data._address)
        arrays = data.qpos, data.qvel, data.ctrl
        return World(*addresses, *arrays, warnings_of(data), substeps)


def warnings_of(data: Any) -> Any:
    """(4,) MuJoCo's counts of bad positions, velocities, accelerations and controls; a view."""
    return data.warning.number[_FIRST : _LAST + 1]


def drive(law: Array | Tracking, world: World, reading: Reading, errors: Errors, log: Log) -> int:
    """Simulates in closed loop and fills a log whose times and first row are given.

    Args:
        law: the commands (N, n_u) at all times, or the parameters of `computed_torque`.
        world: MuJoCo's model and data, in the state of the log's first row.
        reading: index map of the system's coordinates.
        errors: of the sensors.
        log: N samples; receives measurements and commands.

    Returns:
        Number of rows written: N, or up to and including the first row that is not finite or at
        which MuJoCo diverged.
    """
    if isinstance(law, Tracking):
        return track(law, world, reading, errors, log)
    log.u[1:] = law[1:]
    return play(world, reading, errors, log)


@kernel()
def play(world, reading, errors, log):
    """Open loop: simulates with the commands in the log. Returns the number of rows written."""
    numbers = np.empty(log.v.shape[1])
    for k in range(1, log.t.shape[0]):
        q, v, u = log.q[k], log.v[k], log.u[k]
        _advance(world, reading, errors, k - 1, log.u[k - 1], numbers, q, v)
        if not sound(world.warnings, q, v, u):
            return k + 1
    return log.t.shape[0]


@kernel()
def track(tracking, world, reading, errors, log):
    """Closed loop with `computed_torque`. Returns the number of rows written."""
    numbers, workspace = np.empty(log.v.shape[1]), tracking_workspace(tracking)
    for k in range(1, log.t.shape[0]):
        q, v, u = log.q[k], log.v[k], log.u[k]
        _advance(world, reading, errors, k - 1, log.u[k - 1], numbers, q, v)
        computed_torque(tracking, log.t[k], q, v, workspace, u)
        if not sound(world.warnings, q, v, u):
            return k + 1
    return log.t.shape[0]


@kernel()
def _advance(world, reading, errors, k, command, numbers, q, v):
    """Advances by one time step with a command, and writes a measurement with the k-th errors."""
    for i in range(command.shape[0]):
        world.ctrl[i] = command[i]
    for _ in range(world.substeps):
        _mj_step(world.model, world.data)
    read_coordinates(reading, world.qpos, world.qvel, numbers, v)
    add_errors(errors, k, numbers, v)
    write_position(reading, numbers, q)


@kernel()
def sound(warnings, q, v, u):
    """Whether all counts in `warnings` are 0 and q, v and u are finite."""
    total = 0.0
    for count in warnings:
        if count > 0:
            return False
    for part in (q, v, u):
        for number in part:
            total += number
    return np.isfinite(total)
