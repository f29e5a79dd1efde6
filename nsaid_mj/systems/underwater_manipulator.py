"""Underwater vehicles that carry an arm (6): added mass, drag and buoyancy of base and links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from ..dynamics.tree import TWIST
from ..numerics.triples import add, back, cross, dot, scale, three
from ..parameters import Array, Block
from . import actuators, fluid
from .inertial import of_a_body, symmetric
from .joints import body_names
from .loads import carried_force_law
from .multibody import JointScales
from .optional import pin
from .tree import Carried
from .underwater import UnderwaterScales, body_space
from .vehicle_manipulator import VehicleManipulator, link_blocks, pull

STRIPS = 4
"""Points of Gauss-Legendre quadrature along a link's axis."""


@dataclass(frozen=True)
class Cylinders:
    """Known shapes of the k links: slender cylinders, in the links' own axes.

    Attributes:
        centres: (k, 3) [m].
        axes: (k, 3) unit vectors.
        lengths: (k,) [m].
    """

    centres: Array
    axes: Array
    lengths: Array


@dataclass(frozen=True)
class LinkFluidScales:
    """An engineer's guesses for the links in water, which become the scale of θ.

    Attributes:
        added: (k,) added mass of a link that moves across its axis [kg].
        drag: (k,) quadratic drag across the axis, for each metre of it [N·s²/m³].
        buoyancy: (k,) [N].
    """

    added: Array
    drag: Array
    buoyancy: Array


class UnderwaterManipulator(VehicleManipulator):
    """An underwater vehicle (see `UnderwaterVehicle`) with an arm in water.

    θ = [base's M with its added mass (21), links (10 k), links' added mass (k), joints, linear drag
    (6), quadratic drag (6), net weight, righting moments (3), links' drag (k), links' buoyancy (k),
    thrust]. A link is a cylinder about its axis e. Its added mass m_A is distributed evenly along
    the axis and resists transverse motion only, (m_A/L)(1 − e eᵀ) ds; a strip's drag is
    −c |v_⊥| v_⊥ ds; buoyancy acts at the middle.

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are discarded.
        joints: guesses of the links and joints; the base's mass and length are not used.
        base: guesses of the base in water.
        links: guesses of the links in water.
        cylinders: the links' shapes.
        friction_speed: joint speed at which Coulomb friction saturates [rad/s or m/s].
        positions: (t, 3) of the thrusters on the base [m].
        directions: (t, 3) unit vectors along which they push.
        curve: coefficients of u, u³, u⁵ … of the command curve; their sum is 1.
    """

    def __init__(
        self,
        model: pin.Model,
        joints: JointScales,
        base: UnderwaterScales,
        links: LinkFluidScales,
        cylinders: Cylinders,
        friction_speed: float,
        positions: Array,
        directions: Array,
        curve: Array,
    ):
        k = len(cylinders.lengths)
        mass, linear, quadratic, weight, righting, thrust = body_space(base).blocks
        names = body_names(model)[1:]
        added = _per_link("added mass", "added", "kg", links.added, names)
        drag = _per_link("link drag", "link_drag", "N·s²/m³", links.drag, names)
        buoyancy = _per_link("link buoyancy", "buoyancy", "N", links.buoyancy, names)
        full = np.ones(len(positions))
        still = np.zeros((model.nv - 6, len(positions)))
        self.cylinders = cylinders
        law = WaterForces(
            cylinders.centres,
            cylinders.axes,
            *strips(cylinders),
            np.vstack([actuators.wrenches(positions, directions), still]),
            np.asarray(curve, dtype=np.float64),
        )
        super().__init__(
            model,
            [
                Carried(0, symmetric(6, 0, 21), False),
                *(Carried(1 + i, of_a_body(0, 10), True) for i in range(k)),
                *(Carried(1 + i, added_inertia(cylinders, i), False) for i in range(k)),
            ],
            [mass, *link_blocks(model, joints)[1:], added],
            joints,
            friction_speed,
            [linear, quadratic, weight, righting, drag, buoyancy, thrust],
            (-full, full),
            positions,
            base.speed,
            law,
        )


def _per_link(name: str, letter: str, unit: str, scale: Array, links: list[str]) -> Block:
    k = len(scale)
    names = tuple(f"{letter}_{i + 1}" for i in range(k))
    labels = tuple(f"{name.removeprefix('link ')} of {link}" for link in links)
    return Block(name, names, (unit,) * k, scale, "positive", labels=labels)


def added_inertia(cylinders: Cylinders, i: int) -> Array:
    """(6, 6, 1) added inertia of link i in its own frame for an added mass of 1 kg."""
    e, c = cylinders.axes[i], cylinders.centres[i]
    across, lever = np.eye(3) - np.outer(e, e), pin.skew(c)
    middle = np.zeros((6, 6))
    middle[:3, :3], middle[3:, 3:] = across, cylinders.lengths[i] ** 2 / 12 * across
    shift = np.eye(6)  # v at the middle is v − c × ω
    shift[:3, 3:] = -lever
    inertia = shift.T @ middle @ shift
    return (0.5 * (inertia + inertia.T))[:, :, None]


def strips(cylinders: Cylinders) -> tuple[Array, Array]:
    """(k, s, 3) points along the links' axes, in the links' frames, and (k, s) lengths [m]."""
    nodes, weights = np.polynomial.legendre.leggauss(STRIPS)
    half = 0.5 * cylinders.lengths[:, None]
    reach = (half * nodes)[:, :, None] * cylinders.axes[:, None]
    return cylinders.centres[:, None] + reach, half * weights


class WaterForces(NamedTuple):
    """Drag and buoyancy of base and links, and thrusters, for compiled loops.

    Attributes:
        centres: (k, 3) of the links [m].
        axes: (k, 3) unit vectors.
        points: (k, s, 3) of the quadrature along the links [m].
        weights: (k, s) their lengths [m].
        allocation: (n, t) unit forces of the thrusters.
        curve: coefficients of their command curve.
    """

    centres: Array
    axes: Array
    points: Array
    weights: Array
    allocation: Array
    curve: Array


@carried_force_law(WaterForces)
@njit(cache=True)
def _water(forces, linkage, states, u):
    """(N, n, ·) columns of F of drag and buoyancy of base and links, then of the thrusters."""
    centres, axes, points, weights, allocation, curve = forces
    samples, bodies, _ = states.shape
    links = bodies - 1
    F = np.zeros((samples, 6 + links, 16 + 2 * links + u.shape[1]))
    for s in range(samples):
        state, up = states[s], np.empty((bodies, 3))
        column = fluid.linear_drag(F[s], 0, state[0, TWIST : TWIST + 6])
        column = fluid.quadratic_drag(F[s], column, state[0, TWIST : TWIST + 6])
        up[0] = state[0, 6:9]
        column = fluid.restoring(F[s], column, up[0])
        for b in range(1, bodies):
            up[b] = back(state, b, three(up, linkage[1][b, 0], 0))
            k = b - 1
            force, moment = _drag(state, b, three(axes, k, 0), points[k], weights[k])
            pull(linkage, state, b, force, moment, F[s], column + k)
            force = three(up, b, 0)
            moment = cross(three(centres, k, 0), force)
            pull(linkage, state, b, force, moment, F[s], column + links + k)
        actuators.thrusters(F[s], column + 2 * links, allocation, curve, u[s])
    return F


@njit(cache=True)
def _drag(state, b, axis, points, weights):
    """Force and moment of −|v_⊥| v_⊥ summed over the strips of the cylinder of body b."""
    linear, angular = three(state, b, TWIST), three(state, b, TWIST + 3)
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for s in range(weights.shape[0]):
        point = three(points, s, 0)
        across = add(linear, cross(angular, point))
        across = add(across, scale(-dot(axis, across), axis))
        push = scale(-weights[s] * np.sqrt(dot(across, across)), across)
        force, moment = add(force, push), add(moment, cross(point, push))
    return force, moment
