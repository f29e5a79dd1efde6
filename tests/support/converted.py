"""Today's systems as structures, with the same θ, to compare the two."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from nsaid_mj.parameters import Array
from nsaid_mj.structure.columns import curve
from nsaid_mj.structure.parts import Body, Column, Inertia, Rotor, cylinder, full, tied
from nsaid_mj.structure.structure import Structure
from nsaid_mj.systems import torpedo
from nsaid_mj.systems.aerial import GRAVITY, Quadrotor
from nsaid_mj.systems.flying_arm import FlyingArm
from nsaid_mj.systems.ground import CREEP, GroundVehicle
from nsaid_mj.systems.multibody import MotorTree
from nsaid_mj.systems.scalar import ScalarVehicle
from nsaid_mj.systems.space import FreeFlyer
from nsaid_mj.systems.torpedo import TorpedoVehicle
from nsaid_mj.systems.underwater import UnderwaterVehicle
from nsaid_mj.systems.underwater_manipulator import UnderwaterManipulator
from nsaid_mj.systems.vehicle_manipulator import VehicleManipulator

WEIGHTLESS, UNIT, X = np.zeros(3), np.eye(6), np.eye(3)[0]


def convert(system: Any) -> Structure:
    """The structure of any of today's systems."""
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


def _underwater(s: UnderwaterVehicle) -> Structure:
    law = s.forward.forces
    columns = [
        *_axes("linear_drag", 21),
        *_axes("drag", 27),
        Column("weight", 33, body=0),
        *_righting(34),
        *_thrusters("thruster", 37, law.allocation, curve.odd(*law.curve)),
    ]
    return Structure([Body("free")], [Inertia(0, 0, full())], columns, s.p, s.n_u)


def _torpedo(s: TorpedoVehicle) -> Structure:
    law, k = s.forward.forces, s.n_u - 1
    columns = [
        *(
            Column("drag", 6 + i, body=0, axes=axes)
            for i, axes in enumerate(([1, 0, 0, 0, 0, 0], [0, 1, 1, 0, 0, 0],
                                      [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 1]))
        ),
        Column("lift", 10, body=0),
        Column("lift_moment", 11, body=0),
        Column("weight", 12, body=0),
        Column("righting", 13, body=0, axis=[0, 0, 1]),
        Column(
            "propeller", 14, body=0, input=k, point=np.zeros(3), direction=X, slip=law.slip
        ),
        Column("propeller_torque", 15, body=0, input=k, direction=X),
    ]  # fmt: skip
    mounts = s.mounts[2 : 2 + k]
    for i in range(k):
        lift = law.allocation[0, :3, i]
        columns.append(Column("fin", 16 + i, body=0, input=i, point=mounts[i], direction=lift))
    columns += [Column("fin_drag", 16 + k + i, body=0, input=i, point=mounts[i]) for i in range(k)]
    mass = Inertia(0, 0, tied([(j, i, at, value) for i, j, at, value in torpedo._MASS]))
    return Structure([Body("free")], [mass], columns, s.p, s.n_u)


def _quadrotor(s: Quadrotor) -> Structure:
    columns = []
    for k, point in enumerate(s.rotors):
        there = {"body": 0, "input": k, "direction": [0, 0, 1]}
        columns += [
            Column("rotor", 16 + k, point=point, **there),
            Column("rotor_torque", 20 + k, body=0, input=k, direction=[0, 0, s.spin[k]]),
            Column("rotor_inflow", 10, point=point, body=0, direction=[0, 0, 1]),
            Column("rotor_drag", 11, point=point, **there),
            Column("rotor_damping", 12, point=point, **there),
        ]
    columns += [Column("speed_drag", 13 + i, body=0, axes=UNIT[i]) for i in range(3)]
    gravity = [0, 0, -GRAVITY]
    return Structure([Body("free")], [Inertia(0, 0)], columns, s.p, s.n_u, (), gravity)


def _free_flyer(s: FreeFlyer) -> Structure:
    columns = _thrusters("nozzle", 10, s.forward.forces.allocation, curve.LINEAR)
    return Structure([Body("free")], [Inertia(0, 0)], columns, s.p, s.n_u, (), WEIGHTLESS)


def _car(s: GroundVehicle) -> Structure:
    arm = s.forward.forces.arm
    columns = [
        Column("tyre", 3, body=0, input=1, arm=arm),
        Column("tyre", 4, body=0, arm=-arm),
        Column("drive", 5, body=0, input=0),
        Column("drive_loss", 6, body=0, input=0),
        Column("rolling", 7, body=0, speed=CREEP),
        Column("drag", 8, body=0, axes=UNIT[0]),
    ]
    mass = tied([(0, 0, 0, 1.0), (1, 1, 0, 1.0), (1, 5, 1, 1.0), (5, 5, 2, 1.0)])
    return Structure([Body("planar")], [Inertia(0, 0, mass)], columns, s.p, s.n_u)


def _scalar(s: ScalarVehicle) -> Structure:
    columns = [
        Column("quadratic", 1, dof=0),
        Column("weight", 2, body=0),
        Column("motor", 3, dof=0, input=0),
    ]
    mass = Inertia(0, 0, tied([(2, 2, 0, 1.0)]))
    return Structure([Body("slide")], [mass], columns, 4, 1)


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
    UnderwaterVehicle: _underwater,
    TorpedoVehicle: _torpedo,
    Quadrotor: _quadrotor,
    FreeFlyer: _free_flyer,
    GroundVehicle: _car,
    ScalarVehicle: _scalar,
    UnderwaterManipulator: _uvms,
    FlyingArm: _flying_arm,
}
