"""The state of the efficient law's filter, its prior knowledge, and its compiled workspace."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numba import types

from ...numerics.kernels import cube, f8, i8, matrix, vector
from ...parameters import Array
from ...quotient.cone import CONE, Cone
from ...structure.arrays import Slopes, StructureArrays, Workspace, memory_of
from ...structure.compiled import SLOPES, STRUCTURE, WORKSPACE
from ...structure.touching import TOUCH, Touch
from .noise import NOISE, Noise, noise_variance

COMPLETED = 0
CONTRADICTED = 1
ROUNDED = 2
BEGINNING = 3
"""How `follow_filter` ends: at the log's end, at innovations larger than chance allows, or where
rounding errors made the covariance indefinite. A row may also precede the filter's beginning."""
NEAR = 0.3
"""γ near θ: after a filter's first seconds, in trials of faults, rivals, and judging a result."""


class FilterConstants(NamedTuple):
    """Constants of the filter, for compiled loops."""

    structure: StructureArrays  # structure of the system
    cone: Cone  # cone of physical parameters
    scale: Array  # (p,) scale of θ
    margin: Array  # (p,) see `steps.margin_of`
    gamma: float  # γ; after the first seconds `NEAR`, if that is less
    window: int  # samples over which innovations are tested
    walk: Array  # (p,) variance that θ, relative to itself, gains per second [1/s]; 0 if constant
    # (n,) density of the noise of the force on every velocity, over the gain of the last motor, the
    # last parameter [units of its command, squared, times s]; (0,) if there is none
    unexplained: Array
    parts: Array  # (s, p) of `nullspace.parts_of`


class FilterState(NamedTuple):
    """State of the filter at a sample. All arrays are overwritten by `follow_filter`."""

    q: Array  # (m,) estimated position
    v: Array  # (n,) estimated velocity
    theta: Array  # (p,) estimate
    Pxx: Array  # (2n, 2n) covariance of the tangent state
    Pxt: Array  # (2n, p) covariance of the state with θ/scale
    Ptt: Array  # (p, p) covariance of θ/scale
    noise: Noise  # running estimate of the sensors' noise
    # (4,) whether the filter has begun; samples in the current window, and their sums of squared
    # normalised innovations and of log det S
    tally: Array
    safe: Array  # (2, p) θ̂ at the start of the preceding window, and of the current one
    safe_P: Array  # (2, p, p) P_θθ there
    totals: Array  # (2,) sum of all squared normalised innovations, and their number

    @property
    def R(self) -> Array:
        """(2n,) variances of the sensors' noise, bounded below by rounding errors."""
        return noise_variance(self.noise)

    def copied(self) -> FilterState:
        """An independent copy."""
        parts = self._asdict()
        noise = Noise(*(part.copy() for part in parts.pop("noise")))
        return FilterState(noise=noise, **{name: part.copy() for name, part in parts.items()})

    def tested_anew(self) -> FilterState:
        """Resets the test of innovations, keeping state and covariance; returns the filter."""
        self.tally[1:] = 0.0
        self.safe[:], self.safe_P[:] = self.theta, self.Ptt
        return self


def filter_at(q: Array, v: Array, theta: Array, Ptt: Array) -> FilterState:
    """The filter at its first measurement q (m,), v (n,), with P_θθ (p, p) of θ̂/scale."""
    n = len(v)
    p = len(theta)
    noise = Noise(np.zeros((3, 2 * n)), np.zeros(2 * n), np.zeros(2 * n), np.zeros(1))
    safe = np.array([theta, theta])
    safe_P = np.array([Ptt, Ptt])
    Pxx = np.zeros((2 * n, 2 * n))
    Pxt = np.zeros((2 * n, p))
    return FilterState(
        q.copy(),
        v.copy(),
        theta.copy(),
        Pxx,
        Pxt,
        Ptt.copy(),
        noise,
        np.zeros(4),
        safe,
        safe_P,
        np.zeros(2),
    )


class Along(NamedTuple):
    """Outputs of `follow_filter` along a log of N samples, from row 1 on."""

    theta: Array  # (N, p) θ̂
    v: Array  # (N, n) v̂
    pivot: Array  # (N,) M̂'s smallest pivot in the step that ends at the row
    innovation: Array  # (N, 2n) normalised ones, of position and velocity; NaN where there are none

    @staticmethod
    def empty(count: int, n: int, p: int) -> Along:
        """For N rows, n velocities and p parameters."""
        rows = np.empty((count, p)), np.empty((count, n))
        return Along(*rows, np.full(count, np.inf), np.full((count, 2 * n), np.nan))

    def part(self, first: int) -> Along:
        """The rows from `first` on, as views."""
        return Along(*(rows[first:] for rows in self))


class FilterWorkspace(NamedTuple):
    """Workspace of the filter's functions besides a `Filter`, for n velocities and p parameters."""

    stage: Workspace  # workspace of a stage
    slopes: Slopes  # workspace of derivatives
    at: Array  # (m,) a position
    q1: Array  # (m,) predicted position
    v1: Array  # (n,) predicted velocity
    F: Array  # (2n, 3n) derivatives of the prediction by the state and c
    B: Array  # (n, p) derivatives of c by θ/scale
    with_theta: Array  # (3n, p) covariance of (x, c) with θ/scale
    with_c: Array  # (3n, n) that with c
    both: Array  # (3n, 3n) that with itself
    moved: Array  # (2n, 3n) F times that
    S: Array  # (2n, 2n) covariance of the innovation
    L: Array  # (2n, 2n) its factor
    inverse: Array  # (2n, 2n) the factor's inverse
    whitened: Array  # (2n, p) L⁻¹ P̄_xθ
    e: Array  # (2n,) normalised innovation
    y: Array  # (2n,) innovation, then the step of the state
    R: Array  # (2n,) variances of the noise
    step: Array  # (p,) step of θ̂
    before: Array  # (p,) θ̂ before the step
    trial: Array  # (p,) scratch
    factor: Array  # (p, p) scratch
    seen: Array  # (3, n) velocities of joints' columns, see `transition.step`
    touch: Touch  # the contacts in a step

    @staticmethod
    def of(structure: StructureArrays, n: int, m: int, p: int, c: int = 0) -> FilterWorkspace:
        """For n velocities, m positions, p parameters and c components of contacts' forces."""
        sizes = (
            m,
            m,
            n,
            (2 * n, 3 * n),
            (n, p),
            (3 * n, p),
            (3 * n, n),
            (3 * n, 3 * n),
            (2 * n, 3 * n),
            *((2 * n, 2 * n),) * 3,
            (2 * n, p),
            2 * n,
            2 * n,
            2 * n,
            p,
            p,
            p,
            (p, p),
            (3, n),
        )
        work, slopes = memory_of(structure, n)
        arrays = (np.zeros(size) for size in sizes)
        return FilterWorkspace._make([work, slopes, *arrays, Touch.of(c, n)])


_OWN = threading.local()  # workspace of each thread


def workspace_for(structure: StructureArrays, *sizes: int) -> FilterWorkspace:
    """Workspace for a structure with sizes n, m, p and c; every call of a thread overwrites it.

    It serves this structure only: what one tree leaves zero, such as M between two branches,
    another one of the same sizes overwrites.
    """
    key = structure, *sizes
    if getattr(_OWN, "key", (None,))[0] is not structure or _OWN.key[1:] != sizes:
        _OWN.key = key
        _OWN.workspace = FilterWorkspace.of(structure, *sizes)
    return _OWN.workspace


CONSTANTS = types.NamedTuple(
    (STRUCTURE, CONE, vector, vector, f8, i8, vector, vector, matrix), FilterConstants
)
FILTER = types.NamedTuple(
    (vector, vector, vector, matrix, matrix, matrix, NOISE, vector, matrix, cube, vector),
    FilterState,
)
ALONG = types.NamedTuple((matrix, matrix, vector, matrix), Along)
WORKSPACES = types.NamedTuple(
    (
        WORKSPACE,
        SLOPES,
        vector,
        vector,
        vector,
        *(matrix,) * 10,
        *(vector,) * 6,
        matrix,
        matrix,
        TOUCH,
    ),
    FilterWorkspace,
)
