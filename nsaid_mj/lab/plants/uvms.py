"""Underwater vehicles that carry an arm (6): added mass, drag and buoyancy of base and links."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from ...base import pin
from ...core import (
    GRAVITY,
    Array,
    Block,
    Inertia,
    JointScales,
    JointTree,
    Term,
)
from ...robots import VehicleFiles, published_numbers
from .arm import extent
from .world.blueprint import sheet_of
from .world.body import BodyInertia as RigidBody
from .world.body import vehicle_spec
from .world.config import PublishedRobot

BASE = "base"
"""Name of the free joint and of the base body."""
STRIPS = 4
"""Points of Gauss-Legendre quadrature along a link's axis."""

_LINK_COLOR = [0.85, 0.55, 0.15, 1.0]
_JOINT_COLOR = [0.20, 0.22, 0.25, 1.0]
_UNSURE = (
    "linear drag",
    "quadratic drag",
    "net weight",
    "righting moment",
    "thruster gain",
    "added mass",
    "link drag",
    "link buoyancy",
    "viscous friction",
    "Coulomb friction",
    "motor gain",
    "rotor inertia",
)


def uvms() -> PublishedRobot:
    """The structure of the vehicle with its arm, its base alone, and the published θ (p,).

    θ = [base's M with its added mass (21), links (10 k), links' added mass (k), joints, linear drag
    (6), quadratic drag (6), net weight, righting moments (3), links' drag (k), links' buoyancy (k),
    thrust]. A link is a cylinder about its axis e. Its added mass m_A is distributed evenly along
    the axis and resists transverse motion only, (m_A/L)(1 − e eᵀ) ds; a strip's drag is
    −c |v_⊥| v_⊥ ds; buoyancy acts at the middle.
    """
    arm = published_numbers("uvms")
    base = sheet_of("underwater").of("bluerov2").blueprint()
    model = uvms_model(base.rigid, arm)
    joints = _joint_guesses(model, arm)
    links = published_links(arm)
    arms = JointTree.links(model)
    names = arms.body_names[1:]
    k = len(names)
    inertias = [Inertia.full()]
    for i in range(k):
        shape = links.centres[i], links.axes[i], links.lengths[i]
        added = Inertia.cylinder(*shape, body=1 + i, start=21 + 10 * k + i)
        inertias += [Inertia(1 + i, 21 + 10 * i), added]
    own = (f"added_{i + 1}" for i in range(k))
    labels = (f"added mass of {name}" for name in names)
    size = Block.guessed(links.added)
    resisting = Block("added mass", tuple(own), ("kg",) * k, size, "positive", labels=tuple(labels))
    *forces, thrust = base.terms
    drag = Term.of(
        "strip_drag",
        {f"link_drag_{i + 1}": f"drag of {name}" for i, name in enumerate(names)},
        links.drag,
        body=range(1, k + 1),
        axis=links.axes,
        strips=[strips(*cylinder) for cylinder in zip(*links[:3], strict=True)],
    )
    buoyancy = Term.of(
        "buoyancy",
        {f"buoyancy_{i + 1}": f"buoyancy of {name}" for i, name in enumerate(names)},
        links.buoyancy,
        block="link buoyancy",
        body=range(1, k + 1),
        point=links.centres,
    )
    terms = [*forces, drag, buoyancy, thrust]
    bodies = [base.body, *arms.link_blocks(joints.mass, joints.length)[1:], resisting]
    assert joints.rotor is not None
    speed = np.full(k, arm["joints"]["friction_speed"])
    system = JointTree(model, joints, speed, terms, base.operation, inertias, bodies)
    inertial = [body.toDynamicParameters() for body in list(model.inertias)[2:]]
    on_joints = joints.rotor, joints.viscous, joints.coulomb, joints.gain
    beyond = [each.nominal for each in terms]
    theta = np.concatenate([base.theta[:21], *inertial, links.added, *on_joints, *beyond])
    unsure = [(name, 1.0) for name in _UNSURE]
    return PublishedRobot(base, system, theta, unsure)


class Cylinders(NamedTuple):
    """The k links in water as slender cylinders, in the links' own axes."""

    centres: Array  # (k, 3) [m]
    axes: Array  # (k, 3) unit vectors
    lengths: Array  # (k,) [m]
    added: Array  # (k,) added mass of a link that moves across its axis [kg]
    drag: Array  # (k,) quadratic drag across the axis, per metre [N·s²/m³]
    buoyancy: Array  # (k,) [N]


def published_links(arm: dict[str, Any]) -> Cylinders:
    """The links' cylinders, from the numbers of assets/uvms."""
    shapes = [link["cylinder"] for link in arm["links"]]
    water = arm["water_density"]
    start, end = (np.array([shape[key] for shape in shapes]) for key in ("start", "end"))
    lengths = np.linalg.norm(end - start, axis=1)
    axes = (end - start) / lengths[:, None]
    radius = np.array([shape["radius"] for shape in shapes])
    displaced = water * np.pi * radius**2 * lengths
    drag = 0.5 * water * arm["drag_coefficient"] * 2 * radius
    return Cylinders((start + end) / 2, axes, lengths, displaced, drag, GRAVITY * displaced)


def strips(centre: Array, axis: Array, length: float) -> Array:
    """(s, 4) points along a link's axis, in its frame, and the lengths that they represent [m]."""
    nodes, weights = np.polynomial.legendre.leggauss(STRIPS)
    half = 0.5 * length
    return np.column_stack([centre + np.outer(half * nodes, axis), half * weights])


def uvms_model(rigid: Array, arm: dict[str, Any]) -> pin.Model:
    """Pinocchio's model of an underwater base with an arm, with the published inertias.

    `rigid` (6, 6) is the base's rigid-body mass, its centre at the origin; `arm` is of assets/uvms.
    """
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), BASE)
    body = pin.Inertia(rigid[0, 0], np.zeros(3), rigid[3:, 3:])
    model.appendBodyToJoint(root, body, pin.SE3.Identity())
    parent = root
    place = _placement(arm["mount"]["position"], arm["mount"]["angles"])
    for i, link in enumerate(arm["links"]):
        place = place * _placement(link["origin"], link["angles"])
        joint = pin.JointModelRevoluteUnaligned(np.array(link["axis"]))
        limits = (np.array([x]) for x in (np.inf, arm["joints"]["speed"], *link["limits"]))
        parent = model.addJoint(parent, joint, place, f"joint {i + 1}", *limits)
        inertia = pin.Inertia(link["mass"], np.array(link["centre"]), np.diag(link["inertia"]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        place = pin.SE3.Identity()
    return model


def _joint_guesses(model: pin.Model, arm: dict[str, Any]) -> JointScales:
    """Scales of the arm's joints and links, guessed from its data sheet."""
    d = arm["joints"]
    k = len(arm["links"])
    bodies = list(model.inertias)[1:]
    stated = ("viscous", "coulomb", "gain", "speed", "rotor")
    known: dict[str, Any] = {name: np.full(k, d[name]) for name in stated}
    return JointScales(
        mass=Block.guessed(np.array([inertia.mass for inertia in bodies])),
        length=Block.guessed(np.array([extent(inertia) for inertia in bodies])),
        command=np.full(k, 0.5),
        **known,
    )


def add_visual_geoms(spec: Any, arm: dict[str, Any]) -> None:
    """Adds visual geoms without mass: the BlueROV2's to the base, cylinders to the links."""
    unit = RigidBody(1.0, np.zeros(3), np.eye(3))
    hull = vehicle_spec(VehicleFiles.of("bluerov2"), 1.0, unit).compile()
    for i in range(hull.ngeom):
        shown = ("type", "size", "pos", "quat", "rgba")
        own = {key: getattr(hull, f"geom_{key}")[i] for key in shown}
        spec.body(BASE).add_geom(name=hull.geom(i).name, mass=0.0, **own)
    kinds = mujoco.mjtGeom
    for i, link in enumerate(arm["links"]):
        shape = link["cylinder"]
        body = spec.body(f"joint {i + 1}")
        ends = [*shape["start"], *shape["end"]]
        radius = shape["radius"]
        tube = {"type": kinds.mjGEOM_CYLINDER, "fromto": ends, "size": [radius, 0, 0]}
        ball = {"type": kinds.mjGEOM_SPHERE, "size": [1.15 * radius, 0, 0]}
        body.add_geom(name=f"link {i + 1}", rgba=_LINK_COLOR, mass=0.0, **tube)
        body.add_geom(name=f"joint {i + 1}", rgba=_JOINT_COLOR, mass=0.0, **ball)


def _placement(position: list[float], angles: list[float]) -> pin.SE3:
    """The pose with this position [m] and these roll, pitch and yaw angles [rad]."""
    return pin.SE3(pin.rpy.rpyToMatrix(*angles), np.array(position))
