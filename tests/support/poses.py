"""Tangent steps of poses, in space and in the plane, by the kernels of `structure.poses`."""

from __future__ import annotations

import numpy as np

from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.parts import Body, Inertia
from nsaid_mj.core.structure.structure import Structure
from tests.support.evaluation import Evaluation

SPACE, PLANE = (
    Evaluation(Structure([Body(joint)], [Inertia(0, 0)], [], 10, 0)) for joint in ("free", "planar")
)


def pose_integrate(q: Array, step: Array) -> Array:
    """(7,) the pose reached from q (7,) by a twist (6,)."""
    return SPACE.integrate(numbers(q), numbers(step))


def pose_difference(q0: Array, q1: Array) -> Array:
    """(6,) the twist from pose q0 (7,) to q1 (7,)."""
    return SPACE.difference(numbers(q0), numbers(q1))


def planar_integrate(q: Array, step: Array) -> Array:
    """(3,) the pose reached from q (3,) by a twist (3,)."""
    return PLANE.integrate(numbers(q), numbers(step))


def planar_difference(q0: Array, q1: Array) -> Array:
    """(3,) the twist from pose q0 (3,) to q1 (3,)."""
    return PLANE.difference(numbers(q0), numbers(q1))


def numbers(x: Array) -> Array:
    """As kernels read them."""
    return np.array(x, dtype=np.float64)
