"""A segment of a run in one compiled call: MuJoCo's step, sensors, control law.

The arithmetic and its order match the step-by-step loop in `Plant`, bit for bit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import boolean, f8, i8, types, void

from ....core import Array, Log, kernel
from ...control.computed_torque import (
    TRACKING,
    TRACKING_MEMORY,
    Tracking,
    computed_torque,
    tracking_workspace,
)
from .callbacks import c_function
from .coordinates import READING, Reading, read_coordinates, write_position
from .sensors import ERRORS, Errors, add_errors

_FIRST = int(mujoco.mjtWarning.mjWARN_BADQPOS)
_LAST = int(mujoco.mjtWarning.mjWARN_BADCTRL)


_mj_step = c_function("mj_step", types.uintp, types.uintp)


class SimulatedWorld(NamedTuple):
    """MuJoCo's model and data for compiled code; the arrays are views of mjData."""

    model: np.uintp  # address of mjModel
    data: np.uintp  # address of mjData
    qpos: Array  # (nq,)
    qvel: Array  # (nv,)
    ctrl: Array  # (n_u,)
    warnings: Any  # (4,) counts of bad positions, velocities, accelerations and controls
    substeps: int  # calls of mj_step in a time step

    @staticmethod
    def of(model: Any, data: Any, substeps: int) -> SimulatedWorld:
        """Views of a model and its data, which must outlive them."""
        addresses = np.uintp(model._address), np.uintp(data._address)
        arrays = data.qpos, data.qvel, data.ctrl
        return SimulatedWorld(*addresses, *arrays, warnings_of(data), substeps)


def warnings_of(data: Any) -> Any:
    """(4,) MuJoCo's counts of bad positions, velocities, accelerations and controls; a view."""
    return data.warning.number[_FIRST : _LAST + 1]


def drive(
    law: Array | Tracking, world: SimulatedWorld, reading: Reading, errors: Errors, log: Log
) -> int:
    """Simulates in closed loop and fills a log of N samples whose times and first row are given.

    The law is the commands (N, n_u) at all times, or the parameters of `computed_torque`; MuJoCo's
    data are in the state of the log's first row. Returns the number of rows written: N, or up to
    and including the first row that is not finite or at which MuJoCo diverged.
    """
    numbers = np.empty(log.v.shape[1])
    if isinstance(law, Tracking):
        return track(law, world, reading, errors, log, numbers, tracking_workspace(law))
    log.u[1:] = law[1:]
    return play(world, reading, errors, log, numbers)


WARNINGS = types.Array(types.int32, 1, "A")
WORLD = types.NamedTuple(
    (types.uintp, types.uintp, f8[::1], f8[::1], f8[::1], WARNINGS, i8), SimulatedWorld
)
LOG = types.NamedTuple((f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1]), Log)


@kernel(boolean(WARNINGS, f8[::1], f8[::1], f8[::1]))
def sound(warnings, q, v, u):
    """Whether all counts in `warnings` are 0 and q, v and u are finite."""
    total = 0.0
    for k in range(warnings.shape[0]):
        if warnings[k] > 0:
            return False
    for i in range(q.shape[0]):
        total += q[i]
    for i in range(v.shape[0]):
        total += v[i]
    for i in range(u.shape[0]):
        total += u[i]
    return np.isfinite(total)


@kernel(void(WORLD, READING, ERRORS, LOG, i8, f8[::1]), inner=True)
def _advance(world, reading, errors, log, k, numbers):
    """Advances to row k under the previous command, and writes a measurement with errors k.

    `numbers` (n,) is workspace.
    """
    q = log.q[k]
    v = log.v[k]
    for i in range(log.u.shape[1]):
        world.ctrl[i] = log.u[k - 1, i]
    for _ in range(world.substeps):
        _mj_step(world.model, world.data)
    read_coordinates(reading, world.qpos, world.qvel, numbers, v)
    add_errors(errors, k - 1, numbers, v)
    write_position(reading, numbers, q)


@kernel(i8(WORLD, READING, ERRORS, LOG, f8[::1]))
def play(world, reading, errors, log, numbers):
    """Simulates open loop with the commands in the log; returns the number of rows written."""
    for k in range(1, log.t.shape[0]):
        _advance(world, reading, errors, log, k, numbers)
        if not sound(world.warnings, log.q[k], log.v[k], log.u[k]):
            return k + 1
    return log.t.shape[0]


@kernel(i8(TRACKING, WORLD, READING, ERRORS, LOG, f8[::1], TRACKING_MEMORY))
def track(tracking, world, reading, errors, log, numbers, workspace):
    """Simulates in closed loop with `computed_torque`; returns the number of rows written."""
    for k in range(1, log.t.shape[0]):
        _advance(world, reading, errors, log, k, numbers)
        computed_torque(tracking, log.t[k], log.q[k], log.v[k], workspace, log.u[k])
        if not sound(world.warnings, log.q[k], log.v[k], log.u[k]):
            return k + 1
    return log.t.shape[0]
