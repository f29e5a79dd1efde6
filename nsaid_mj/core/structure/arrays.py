"""The data layout of a compiled robot, which all kernels read, and their workspace.

A robot is a tree of bodies, numbered from the base outwards. Each has a joint to its parent or the
ground. All kernels work in one inertial *common frame*: the world's for a fixed base, and for a
free flyer or a vehicle in the plane the one that coincides with the base at the measured pose.
Spatial vectors are [linear, angular], about the common frame's origin and in its axes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FIXED, FREE, PLANAR, HINGE, SLIDE, CIRCLE = range(6)
"""Kinds of joint: weld, free flyer, pose in the plane, angle, travel, angle as (cos, sin)."""

VELOCITIES = (0, 6, 3, 1, 1, 1)
POSITIONS = (0, 7, 3, 1, 1, 2)
"""Numbers of velocities and positions of each kind of joint."""

(
    PARENT,
    KIND,
    AT_Q,
    AT_V,
    COUNT,
    TEN,
    FIRST,
    LAST,
    TERM,
    TERMS,
    RIGID,
    GENERAL,
    DENSE,
    BODY,
) = range(14)
"""Columns of `StructureArrays.bodies`: parent or −1; kind of joint; its first position, first
velocity and number of velocities; first of ten rigid-body parameters or −1; range of `entries`, and
of `terms`; whether the body, or one that it carries, has rigid-body parameters, whether entries,
and whether entries or columns."""

OF = 0
FROM = 1
TO = 2
OWNER = 3
"""Columns of `StructureArrays.terms`: parameter; range of `entries`; body."""

COSINE = 9
SINE = 18
PLACE = 27
AXIS = 30
JOINT = 33
"""Columns of `StructureArrays.joints`: R₀, R_c and R_s (9 each), with R₀ + R_c cos + R_s sin the
body's axes in its parent's; position in the parent's frame; axis in the body's axes."""

SORT, AT, INPUT, CONSTANTS, NONZEROS, PARAMETER, READS, COLUMN = range(8)
"""Columns of `StructureArrays.columns`: number of the kind; body; command or −1; offset in
`constants`; offset in `nonzeros`; parameter; what its value depends on, from `NOTHING` on."""

NOTHING, SPEED, POSE = range(3)
"""The dependence of a column's value: on nothing, or on velocity or pose of its body or joint."""

POSITION = 9
TWIST = 12
RATE = 6
FRAME = 18
"""Columns of a state. A body's row: rotation to the common frame (9), position, twist V. A
velocity's row: its axis S, and Ṡ = dS/dt in an inertial frame. The row after: up and gravity. Then,
for every term, the matrix (36) in the common frame that its parameter multiplies."""
FALL = 3


class StructureArrays(NamedTuple):
    """One robot's equations."""

    bodies: Integers  # (b, BODY) see `PARENT` and following
    joints: Array  # (b · JOINT,) see `COSINE` and following
    gravity: Array  # (3,) in the world's axes [m/s²]
    # (r, 3) rows [velocity, velocity, parameter]: entry of M of what turns with one joint, or two
    rotors: Integers
    entries: Integers  # (e, 3) [i, j, parameter], i ≤ j: entry of a body's 6×6 inertia in its axes
    values: Array  # (e,) the entry is value · θ
    # (k, 4) the entries of one parameter on a body that moves in the common frame, see `OF`; the
    # entries of a free base, constant there, belong to none
    terms: Integers
    columns: Integers  # (c, COLUMN) the terms of F θ; see `SORT` and following
    constants: Array  # all columns' constants
    nonzeros: Integers  # (z, 2) rows [velocity, parameter] of entries of F that can differ from 0


VELOCITY = 0
DRIFT = 6
WRENCH = 12
PUSH = 18
FIELD = 24
MOTION = 36
"""Columns of `Workspace.motion`: W; J̇ w; the wrench; J a; field of a rigid body.

See `forward_dynamics`.
"""

SQUARE = 10
INERTIA = 46
"""Columns of `Workspace.inertia`: ten rigid-body parameters, then the other entries (6, 6)."""

SCRATCH = 96
SPARE = 6
ROWS = 7
"""Sizes of the workspace; its last row is for `derivatives`, those before are for a step."""


class Workspace(NamedTuple):
    """Workspace of a stage. Kernels allocate nothing."""

    motion: Array  # (b · MOTION,) motion of the bodies
    inertia: Array  # (b · INERTIA,) of every body with all that it carries, in the common frame
    M: Array  # (n, n) mass matrix, lower triangle
    L: Array  # (n, n) its factor
    rows: Array  # (ROWS, n) vectors of velocities
    scratch: Array  # (SCRATCH,) vectors of one body


SPEED_SLOPE = 36
TURN_SLOPE = 72
LOAD = 108
IMPULSE = 114
CHANGE = 120
SLOPE = 126
BENT = 0
TWICE = 6
MOVED = 12
"""Columns of `Slopes.bodies`, after the inertia, and of `Slopes.axes`: Ψ̇, Ψ̈, Ψ̇ + Ṡ."""


class Slopes(NamedTuple):
    """Workspace for derivatives of the forward dynamics, see `derivatives`."""

    state: Array  # state of a sample
    # (b · SLOPE,) of every body with all that it carries: of entries and columns the inertia (6, 6)
    # and the derivatives of the wrench by twist (6, 6) and by a turn (6, 6); the total wrench; of
    # rigid-body parameters the momentum, and the rate of Ī (6,)
    bodies: Array
    axes: Array  # (n · FRAME,) of every velocity
    F: Array  # (z,) entries of F
    by_state: Array  # (n, 2n) derivatives of v̇
    flow: Array  # (4n, 3n) workspace of a step's derivatives


def workspace(bodies: int, n: int) -> Workspace:
    """Workspace of a stage, for a robot of so many bodies and velocities."""
    return Workspace(
        np.zeros(bodies * MOTION),
        np.zeros(bodies * INERTIA),
        np.zeros((n, n)),
        np.zeros((n, n)),
        np.zeros((ROWS, n)),
        np.zeros(SCRATCH),
    )


def memory_of(structure: StructureArrays, n: int) -> tuple[Workspace, Slopes]:
    """Workspaces of a stage and for derivatives, for a structure with n velocities."""
    bodies = len(structure.bodies)
    terms = len(structure.terms)
    return workspace(bodies, n), Slopes(
        np.zeros((bodies + n + 1 + 2 * terms) * FRAME),
        np.zeros(bodies * SLOPE),
        np.zeros(n * FRAME),
        np.zeros(len(structure.nonzeros)),
        np.zeros((n, 2 * n)),
        np.zeros((4 * n, 3 * n)),
    )
