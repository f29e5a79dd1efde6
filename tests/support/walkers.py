"""Robots on the ground, of example-robot-data: their systems with contacts, and a true θ."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from nsaid_mj.base import pin
from nsaid_mj.core import ContactPoint, JointScales, JointTree
from nsaid_mj.core.structure.joints import floats
from nsaid_mj.robots import load_robot

SOLE = 0.1  # height of a flat foot's last joint above the sole [m]


def identified(model, contacts, friction_speed=0.05):
    """The system of a model with motors, friction, rotors and contacts, and its θ with gains 1."""
    bodies = model.njoints - 1
    one = np.ones(model.nv - (6 if floats(model) else 0))
    parts = {"viscous": 0.1, "coulomb": 0.1, "gain": 1.0, "speed": 5.0, "command": 3.0}
    sizes = {name: value * one for name, value in parts.items()}
    mass = np.full(bodies, 0.2)
    scales = JointScales(mass, np.full(bodies, 0.15), rotor=0.01 * one, **sizes)
    system = JointTree.checked(model, scales, friction_speed * one)
    links = [model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]
    theta = np.concatenate([*links, 0.01 * one, 0.1 * one, 0.1 * one, one])
    structure = replace(system.structure, contacts=tuple(contacts))
    return system.rebuilt(structure, system.space), theta


def quadruped_feet(model, radius=0.0):
    """The four contacts of solo12."""
    feet = [frame for frame in model.frames if frame.name.endswith("_FOOT")]
    return [
        ContactPoint(foot.parentJoint - 1, foot.placement.translation, radius, name=foot.name)
        for foot in feet
    ]


@cache
def quadruped(radius=0.0, base="free"):
    """solo12, twelve joints, with point feet or round ones; on a stand, without contacts."""
    model = load_robot("solo12", base).model
    return identified(model, quadruped_feet(model, radius) if base == "free" else ())


@cache
def biped(base="free"):
    """The legs of talos, twice six joints, with flat feet, the upper body rigid."""
    model = load_robot("talos", base).model
    first = 2 if floats(model) else 1
    upper = [i for i in range(first, model.njoints) if not model.names[i].startswith("leg")]
    model = pin.buildReducedModel(model, upper, pin.neutral(model))
    last = [model.getJointId(f"leg_{side}_6_joint") for side in ("left", "right")]
    feet = [ContactPoint(joint - 1, (0.0, 0.0, -SOLE), flat=True) for joint in last]
    return identified(model, feet if base == "free" else ())


@cache
def pushing_arm(held=True):
    """ur5 whose tool's tip, a point, touches a wall."""
    model = load_robot("ur5").model
    tip = ContactPoint(model.njoints - 2, (0.0, 0.1, 0.05), normal=(1.0, 0.0, 0.0))
    return identified(model, [tip] if held else ())


GAINS = np.array([0.75, 1.2, 0.9, 1.25, 0.8, 1.1, 0.7, 1.3, 1.05, 0.85, 1.15, 0.95])
"""The motors' gains of `walk`; those of `quadruped` are 1."""


@cache
def walk(duration=4.0, dt=1e-3):
    """A log of solo12 on a floor in MuJoCo, squatting and trotting under PD control, and its θ."""
    import mujoco

    from nsaid_mj.core import Log
    from nsaid_mj.robots import tree_spec

    model = load_robot("solo12", "free").model
    spec = tree_spec(model, dt)
    spec.option.disableflags = 0
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for foot in quadruped_feet(model, 0.02):
        body = spec.body(model.names[foot.body + 1])
        ball = mujoco.mjtGeom.mjGEOM_SPHERE
        body.add_geom(type=ball, size=[foot.radius, 0, 0], pos=foot.centre, mass=0)
    plant = spec.compile()
    plant.dof_armature[6:] = 0.01
    plant.dof_damping[6:] = 0.02
    data = mujoco.MjData(plant)
    mujoco.mj_setConst(plant, data)
    bends = 0.75 * np.ones(4)
    data.qpos[:] = [0, 0, 0.28, 1, 0, 0, 0, *np.ravel([(0.0, b, -2 * b) for b in bends])]
    rows = []
    for k in range(-300, round(duration / dt) + 1):
        t = max(k, 0) * dt
        pairs = np.sin(4 * np.pi * t) * np.array([1, -1, -1, 1])
        bend = bends + 0.3 * np.sin(7 * t) + 0.1 * np.sin(15 * t) * np.array([1, -1, 1, -1])
        bend = bend + 0.3 * np.maximum(pairs, 0) * (t > duration / 2)
        sway = 0.1 * np.sin(6 * t) * np.ones(4)
        goal = np.ravel(np.column_stack([sway, bend, -2 * bend]))
        u = 6.0 * (goal - data.qpos[7:]) - 0.2 * data.qvel[6:]
        if k >= 0:
            quaternion = data.qpos[[4, 5, 6, 3]]
            turn = pin.Quaternion(*data.qpos[3:7]).matrix()
            q = np.r_[data.qpos[:3], quaternion, data.qpos[7:]]
            rows.append((t, q, np.r_[turn.T @ data.qvel[:3], data.qvel[3:]], u))
        data.qfrc_applied[6:] = GAINS * u
        mujoco.mj_step(plant, data)
    theta = quadruped(0.02)[1].copy()
    theta[-12:] = GAINS
    theta[-24:-12] = 1e-6  # no Coulomb friction
    theta[-36:-24] = 0.02
    return Log(*map(np.array, zip(*rows, strict=True))), theta
