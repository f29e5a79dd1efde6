"""Today's systems as structures, with the same θ, to compare the two."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from nsaid_mj.parameters import Array
from nsaid_mj.structure.columns import curve
from nsaid_mj.structure.parts import Body, Column, Inertia, Rotor, cylinder, full
from nsaid_mj.structure.structure import Structure
from nsaid_mj.systems.flying_arm import FlyingArm
from nsaid_mj.systems.multibody import MotorTree
from nsaid_mj.systems.structured import StructuredSystem
from nsaid_mj.systems.underwater_manipulator import UnderwaterManipulator
from nsaid_mj.systems.vehicle_manipulator import VehicleManipulator

UNIT = np.eye(6)


def convert(system: Any) -> Structure:
    """The structure of any of today's systems."""
    if isinstance(system, StructuredSystem):
        return system.structure
    for kind, converter in CONVERTERS.items():
        if isinstance(system, kind):
            return converter(system)
    raise TypeError(type(system).__name__)


def _bodies(model: pin.Model) -> list[Body]:
    """The tree of a Pinocchio model."""
    data, bodies = model.createData(), []
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for joint in list(model.joints)[1:]:
        parent, place = model.parents[joint.id] - 1, model.jointPlacements[joint.id]
        if joint.nv == 6:
            bodies.append(Body("free"))
            continue
        jacobian = pin.getJointJacobian(model, data, joint.id, pin.ReferenceFrame.LOCAL)
        axis = jacobian.reshape(6, -1)[:, joint.idx_v]
        turns = np.linalg.norm(axis[3:]) > 0.5
        kind = ("circle" if joint.nq == 2 else "hinge") if turns else "slide"
        own = axis[3:] if turns else axis[:3]
        bodies.append(Body(kind, parent, own, place.rotation, place.translation))
    return bodies


def _joints(system: Any, start: int, first: int, speed: Array) -> tuple[list[Rotor], list[Column]]:
    """Rotors and columns of the joints, whose parameters begin at `start`."""
    k, rotors = len(system.joints), []
    if k and system.scales.rotor is not None:
        rotors = [Rotor(first + i, start + i) for i in range(k)]
    start += len(rotors)
    columns = [Column("viscous", start + i, dof=first + i) for i in range(k)]
    columns += [Column("coulomb", start + k + i, dof=first + i, speed=speed[i]) for i in range(k)]
    columns += [Column("motor", start + 2 * k + i, dof=first + i, input=i) for i in range(k)]
    return rotors, columns


def _arm(s: MotorTree) -> Structure:
    rigid = [Inertia(b, 10 * b) for b in range(s.bodies)]
    rotors, columns = _joints(s, 10 * s.bodies, s.group, s.friction_speed)
    gravity = s.model.gravity.linear.copy()
    return Structure(_bodies(s.model), rigid, columns, s.p, s.n_u, rotors, gravity)


def _axes(kind: str, start: int) -> list[Column]:
    return [Column(kind, start + i, body=0, axes=UNIT[i]) for i in range(6)]


def _righting(start: int) -> list[Column]:
    return [Column("righting", start + i, body=0, axis=UNIT[i, :3]) for i in range(3)]


def _thrusters(kind: str, start: int, allocation: Array, shape: Array, first: int = 0):
    """Columns of thrusters by their unit wrenches (6, k); the first one's command is `first`."""
    columns = []
    for k, wrench in enumerate(allocation[:6].T):
        d, n = wrench[:3], wrench[3:]
        point = np.cross(d, n)  # the point nearest to the origin on the line of action
        columns.append(
            Column(kind, start + k, body=0, input=first + k, point=point, direction=d, curve=shape)
        )
    return columns


def _carrier(s: VehicleManipulator, inertias: list[Inertia]) -> tuple[Any, list[Any]]:
    """Structure's first arguments for a vehicle with an arm, with the joints' columns."""
    start = int(s.loaded.linkage.columns[0])
    k = len(s.joints)
    rotors, columns = _joints(s, start, 6, np.full(k, s.friction_speed))
    return (_bodies(s.model), inertias, rotors), columns


def _uvms(s: UnderwaterManipulator) -> Structure:
    law, k = s.forward.forces, len(s.cylinders.lengths)
    inertias = [Inertia(0, 0, full())]
    for i, (centre, axis, length) in enumerate(
        zip(s.cylinders.centres, s.cylinders.axes, s.cylinders.lengths, strict=True)
    ):
        inertias += [
            Inertia(1 + i, 21 + 10 * i),
            Inertia(1 + i, 21 + 10 * k + i, cylinder(centre, axis, length)),
        ]
    (bodies, inertias, rotors), columns = _carrier(s, inertias)
    at = s._vehicle
    columns += [*_axes("linear_drag", at), *_axes("drag", at + 6)]
    columns += [Column("weight", at + 12, body=0), *_righting(at + 13)]
    for i in range(k):
        strips = np.hstack([law.points[i], law.weights[i][:, None]])
        columns.append(
            Column("strip_drag", at + 16 + i, body=1 + i, axis=law.axes[i], strips=strips)
        )
        columns.append(Column("buoyancy", at + 16 + k + i, body=1 + i, point=law.centres[i]))
    shape = curve.odd(*law.curve)
    columns += _thrusters("thruster", at + 16 + 2 * k, law.allocation, shape, k)
    gravity = s.model.gravity.linear.copy()
    return Structure(bodies, inertias, columns, s.p, s.n_u, rotors, gravity)


def _flying_arm(s: FlyingArm) -> Structure:
    (bodies, inertias, rotors), columns = _carrier(s, [Inertia(b, 10 * b) for b in range(s.bodies)])
    at, k, joints = s._vehicle, s.allocation.shape[2], len(s.joints)
    columns += _thrusters("rotor", at, s.allocation[0], curve.SQUARED, joints)
    columns += [
        Column(
            "rotor_torque", at + k + i, body=0, input=joints + i,
            direction=s.allocation[1, 3:6, i],
        )
        for i in range(k)
    ]  # fmt: skip
    gravity = s.model.gravity.linear.copy()
    return Structure(bodies, inertias, columns, s.p, s.n_u, rotors, gravity)


CONVERTERS: dict[type, Any] = {
    MotorTree: _arm,
    UnderwaterManipulator: _uvms,
    FlyingArm: _flying_arm,
}
