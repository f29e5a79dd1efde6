"""Underwater vehicles that carry an arm (6): added mass, drag and buoyancy of base and links."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parameters import Array, Block
from ..structure.parts import Column, Inertia, cylinder, full
from .joints import body_names
from .multibody import JointScales, link_blocks
from .optional import pin
from .vehicle import SingleBody
from .vehicle_manipulator import VehicleManipulator

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
    """An underwater vehicle with an arm in water.

    θ = [base's M with its added mass (21), links (10 k), links' added mass (k), joints, linear drag
    (6), quadratic drag (6), net weight, righting moments (3), links' drag (k), links' buoyancy (k),
    thrust]. A link is a cylinder about its axis e. Its added mass m_A is distributed evenly along
    the axis and resists transverse motion only, (m_A/L)(1 − e eᵀ) ds; a strip's drag is
    −c |v_⊥| v_⊥ ds; buoyancy acts at the middle.

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are discarded.
        joints: guesses of the links and joints; the base's mass and length are not used.
        base: the vehicle without its arm, see `plants.underwater.UnderwaterSheet.blueprint`.
        links: guesses of the links in water.
        cylinders: the links' shapes.
        friction_speed: joint speed at which Coulomb friction saturates [rad/s or m/s].
    """

    def __init__(
        self,
        model: pin.Model,
        joints: JointScales,
        base: SingleBody,
        links: LinkFluidScales,
        cylinders: Cylinders,
        friction_speed: float,
    ):
        k = len(cylinders.lengths)
        assert base.mounts is not None
        mass, linear, quadratic, weight, righting, thrust = base.space.blocks
        own = len(mass)
        names = body_names(model)[1:]
        added = _per_link("added mass", "added", "kg", links.added, names)
        drag = _per_link("link drag", "link_drag", "N·s²/m³", links.drag, names)
        buoyancy = _per_link("link buoyancy", "buoyancy", "N", links.buoyancy, names)
        self.cylinders = cylinders
        inertias, forces = [Inertia(0, 0, full())], base.structure.columns
        columns = [c.shifted(-own) for c in forces if c.kind != "thruster"]
        shapes = cylinders.centres, cylinders.axes, cylinders.lengths
        for i, (centre, axis, length) in enumerate(zip(*shapes, strict=True)):
            points = strips(centre, axis, length)
            inertias += [
                Inertia(1 + i, 21 + 10 * i),
                Inertia(1 + i, 21 + 10 * k + i, cylinder(centre, axis, length)),
            ]
            columns += [
                Column("strip_drag", 16 + i, body=1 + i, axis=axis, strips=points),
                Column("buoyancy", 16 + k + i, body=1 + i, point=centre),
            ]
        thrusters = [c.shifted(2 * k - own) for c in base.columns("thruster")]
        super().__init__(
            model,
            inertias,
            [mass, *link_blocks(model, joints)[1:], added],
            joints,
            friction_speed,
            [linear, quadratic, weight, righting, drag, buoyancy, thrust],
            [*columns, *thrusters],
            base.operation.command,
            base.mounts,
            base.operation.velocity[1],
        )


def _per_link(name: str, letter: str, unit: str, scale: Array, links: list[str]) -> Block:
    k = len(scale)
    names = tuple(f"{letter}_{i + 1}" for i in range(k))
    labels = tuple(f"{name.removeprefix('link ')} of {link}" for link in links)
    return Block(name, names, (unit,) * k, scale, "positive", labels=labels)


def strips(centre: Array, axis: Array, length: float) -> Array:
    """(s, 4) points along a link's axis, in its frame, and the lengths that they stand for [m]."""
    nodes, weights = np.polynomial.legendre.leggauss(STRIPS)
    half = 0.5 * length
    return np.column_stack([centre + np.outer(half * nodes, axis), half * weights])
