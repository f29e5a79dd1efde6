"""Logs of simulated robots that stand, trot and wave their legs, with errors that real ones have.

    python -m tests.court.walking FOLDER --seed 3 --robot go2

writes FOLDER/walk.csv, what a user would have; nominal.xml and, where there is one, the path of the
URDF, what a user believes; truth.json and truth.npz, for judges. Ground, friction and motors are
MuJoCo's own: `frictionloss`, armature, spheres and boxes in contact with a plane.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import mujoco
import numpy as np

from nsaid_mj.core import ContactPoint
from nsaid_mj.lab.control.gait import Gait
from nsaid_mj.lab.control.walking import Walk
from nsaid_mj.robots import load_robot, load_tree, tree_spec

Array = np.ndarray

_CONTROL = 1e-3  # period of the PD controllers [s]
_STEP = 5e-4  # MuJoCo's time step [s]
_PULLING = 9.0  # period with which something pulls at a leg [s]


@dataclass(frozen=True)
class Legged:
    """A robot with feet.

    Attributes:
        source: its name in example-robot-data.
        feet: prefix of each foot's frame, or of the link whose sole is the box `sole`.
        leg: standing joints of one leg [rad].
        radius: of its round feet [m].
        sole: centre and half lengths of a flat foot in the frame of its link [m]; () if round.
        imu: place of the IMU in the base [m].
        locked: parts of the names of joints that are fixed at 0.
        stiffness: of its joints, over weight · standing height [1/rad].
        walk: its motion.
    """

    source: str
    feet: tuple[str, ...]
    leg: tuple[float, ...]
    radius: float = 0.02
    sole: tuple[tuple[float, ...], ...] = ()
    imu: tuple[float, float, float] = (0.0, 0.0, 0.0)
    locked: tuple[str, ...] = ()
    stiffness: float = 3.0
    walk: dict[str, float] = field(default_factory=dict)


_CORNERS = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
ROBOTS = {
    "go2": Legged("go2", _CORNERS, (0.0, 0.8, -1.6), 0.022, imu=(-0.026, 0.0, 0.042)),
    "go1": Legged("go1", _CORNERS, (0.0, 0.8, -1.6), 0.02, imu=(-0.016, -0.067, -0.006)),
    "solo12": Legged(
        "solo12",
        ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
        (0.0, 0.75, -1.5),
        0.012,
        imu=(0.1, 0.01, 0.02),
    ),
    "anymal_c": Legged(
        "anymal_c",
        ("LF_FOOT", "LH_FOOT", "RF_FOOT", "RH_FOOT"),
        (0.0, 0.5, -1.0),
        0.03,
        imu=(0.249, 0.008, 0.046),
    ),
    "g1": Legged(  # a biped: its arms are held
        "g1",
        ("left_ankle_roll_link", "right_ankle_roll_link"),
        (-0.3, 0.0, 0.0, 0.6, -0.3, 0.0),
        sole=((0.035, 0.0, -0.03), (0.16, 0.09, 0.005)),
        imu=(0.045, 0.0, -0.083),
        locked=("waist", "shoulder", "elbow", "wrist"),
        stiffness=8.0,
        walk={
            "squat": 5.0,
            "trot": 0.0,
            "wave": 11.0,
            "ramp": 2.0,
            "depth": 0.04,
            "sway": 0.01,
            "tilt": 0.04,
            "lean": 1.0,
            "reach": 0.1,
        },
    ),
}


@dataclass(frozen=True)
class WalkingLog:
    """What is drawn or chosen for a log.

    Attributes:
        robot: a key of `ROBOTS`.
        seed: of everything that is drawn.
        seconds: duration [s].
        rate: rows per second.
        command: whether u is each joint's torque command, or its position target.
        hold: time for which the position target behind a torque holds [s], as of a policy. The PD
            law runs at 1 kHz; a row at a step of the target has the torque after it.
        masses: largest relative error of each link's mass and inertia.
        gains: largest relative error of each motor's gain, of kp and kv.
        friction: largest relative error of armature, viscous and Coulomb friction.
        foot_offset: largest displacement of a foot's centre from where the file has it [m].
        sliding: coefficient of friction between feet and ground.
        soft: time constant of the ground [s]; MuJoCo's default is 0.02.
        noise: factor of the noise of all sensors; 1 is typical, 0 none.
        bits: of the encoders, over a turn; 0 for exact ones.
        imu_bias: largest bias of the gyro [rad/s]; of the accelerometer ten times that [m/s²].
        imu_shift: displacement of the IMU from where the file has it [m].
        imu_turn: rotation vector of the IMU from how the file has it [rad].
        imu_late: delay of the IMU's columns behind the joints' [s].
        late: time from a command in the log to the motors [s].
        zeros: largest error of each joint's zero [rad].
        on_stand: whether the base is held, level.
        pulled: sideways force on the first leg's last link, during a third of the log [N].
    """

    robot: str = "go2"
    seed: int = 0
    seconds: float = 60.0
    rate: float = 200.0
    command: Literal["torque", "position"] = "torque"
    hold: float = 0.001
    masses: float = 0.2
    gains: float = 0.3
    friction: float = 0.3
    foot_offset: float = 0.0
    sliding: float = 0.8
    soft: float = 0.02
    noise: float = 1.0
    bits: int = 14
    imu_bias: float = 0.0
    imu_shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    imu_turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    imu_late: float = 0.0
    late: float = 0.0
    zeros: float = 0.0
    on_stand: bool = False
    pulled: float = 0.0


@dataclass(frozen=True)
class Walked:
    """A log and its truth.

    Attributes:
        log: path of the CSV file: time, q_, dq_, u_ (of position servos target_) of every joint,
            imu_qw … imu_qz, gyro_x …, acc_x ….
        model: path of the nominal MJCF, with feet, floor, IMU, nominal armature and friction.
        urdf: path of the nominal URDF.
        truth: by name, of the joints in the file's order: gains (relative to the file's), armature,
            viscous, coulomb, kp, kv (of position servos), mass (of the links), mass_ratio, feet.
        forces: (N, f, 6) contact wrenches on each foot at its centre, in the world's axes
            [N, N·m].
        base: (N, 7) position and quaternion (w, x, y, z) of the base.
    """

    log: Path
    model: Path
    urdf: Path
    truth: dict[str, Any]
    forces: Array
    base: Array

    @property
    def upright(self) -> bool:
        """Whether the robot never fell: its base kept half its height, within 45° of level."""
        height = self.base[:, 2]
        upwards = 1 - 2 * (self.base[:, 4] ** 2 + self.base[:, 5] ** 2)
        return bool((height > 0.5 * height[0]).all() and (upwards > 0.7).all())


def drawn_walk(seed: int, folder: Path, robot: str | None = None, **chosen: Any) -> Walked:
    """A log with all errors of a healthy robot drawn from the seed; `chosen` fields are not."""
    rng = np.random.default_rng([48, seed])
    drawn = {
        "rate": float(rng.choice([200.0, 500.0])),
        "foot_offset": 0.005 * rng.random(),
        "sliding": float(rng.choice([0.35, 0.8])),
        "soft": float(rng.choice([0.02, 0.05])),
        "noise": float(rng.uniform(0.5, 1.5)),
        "imu_bias": 0.005 * rng.random(),
    }
    robot = robot or str(rng.choice(sorted(ROBOTS)))
    return walked(WalkingLog(**({"robot": robot, "seed": seed} | drawn | chosen)), folder)


def walked(what: WalkingLog, folder: Path) -> Walked:
    """Simulates a log and writes its files into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    legged = ROBOTS[what.robot]
    urdf = folder / "nominal.urdf"
    write_nominal_urdf(legged, urdf)
    robot = load_robot(str(urdf), "free")
    rng = np.random.default_rng([what.seed, 1])
    size = _size(robot, legged)
    spec = _scene(robot, legged, what, size, None)
    model = folder / "nominal.xml"
    spec.compile()
    model.write_text(spec.to_xml(), encoding="utf-8")
    truth = _drawn(robot, legged, what, size, rng)
    spec = _scene(robot, legged, what, size, truth)
    rows, forces, base = _simulated(robot, legged, what, size, spec, truth)
    names = _header(robot, what)
    log = folder / "walk.csv"
    np.savetxt(log, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    plain = {key: np.asarray(value).tolist() for key, value in truth.items()}
    text = json.dumps({"log": asdict(what), "truth": plain}, indent=1)
    (folder / "truth.json").write_text(text, encoding="utf-8")
    np.savez_compressed(folder / "truth.npz", forces=forces, base=base)
    return Walked(log, model, urdf, truth, forces, base)


def write_nominal_urdf(legged: Legged, path: Path) -> None:
    """Writes the robot's URDF without meshes, its locked joints fixed."""
    source = load_tree(legged.source).file
    assert source is not None
    root = ElementTree.parse(source).getroot()
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for joint in root.iter("joint"):
        if any(part in joint.get("name", "") for part in legged.locked):
            joint.set("type", "fixed")
    ElementTree.ElementTree(root).write(path, encoding="utf-8")


@dataclass(frozen=True)
class Size:
    """Sizes from which nominal values follow.

    Attributes:
        weight: weight times standing height [N·m].
        inertia: mass times squared standing height [kg·m²].
        height: standing height of the base over the ground [m].
        q: (k,) standing joints [rad].
        feet: contact points.
        kp: stiffness of the joints [N·m/rad].
    """

    weight: float
    inertia: float
    height: float
    q: Array
    feet: list[ContactPoint]
    kp: float

    @property
    def kv(self) -> float:
        """Their damping [N·m·s/rad]."""
        return 0.03 * self.kp

    @property
    def nominal(self) -> dict[str, float]:
        """Armature, viscous and Coulomb friction of a joint."""
        return {
            "armature": 0.008 * self.inertia,
            "viscous": 0.002 * self.weight,
            "coulomb": 0.004 * self.weight,
        }


def contact_points(robot: Any, legged: Legged) -> list[ContactPoint]:
    """The feet, as the file has them."""
    found = []
    for name in legged.feet:
        frame = robot.model.frames[robot.model.getFrameId(name)]
        place = frame.placement
        centre = place.translation
        if legged.sole:
            centre = place.act(np.array(legged.sole[0]) - [0.0, 0.0, legged.sole[1][2]])
        body = frame.parentJoint - 1
        flat = bool(legged.sole)
        radius = 0.0 if flat else legged.radius
        found.append(ContactPoint(body, centre, radius, flat, name=name))
    return found


def _size(robot: Any, legged: Legged) -> Size:
    joints = len(robot.joints)
    q = np.resize(np.array(legged.leg), joints)
    if what := [k for k, name in enumerate(robot.joints) if name in ("LH_HFE", "RH_HFE")]:
        q[what] *= -1  # ANYmal's hind knees point forward
        q[[k + 1 for k in what]] *= -1
    feet = contact_points(robot, legged)
    at = robot.system.position(np.r_[np.zeros(6), q])[None]
    places = robot.system.contact_jacobians(feet, at)[1][0]
    height = -float(places[:, 2].min())
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    weight = 9.81 * mass * height
    return Size(weight, mass * height**2, height, q, feet, legged.stiffness * weight)


def _drawn(
    robot: Any, legged: Legged, what: WalkingLog, size: Size, rng: np.random.Generator
) -> dict[str, Any]:
    joints = len(robot.joints)
    links = len(robot.model.inertias) - 1

    def factors(error: float, count: int) -> Array:
        return 1 + error * rng.uniform(-1, 1, count)

    own = size.nominal
    ratio = factors(what.masses, links)
    masses = np.array([inertia.mass for inertia in list(robot.model.inertias)[1:]])
    sphere = rng.standard_normal((len(size.feet), 3))
    sphere *= what.foot_offset / np.linalg.norm(sphere, axis=1)[:, None]
    truth = {
        "joints": list(robot.joints),
        "gains": factors(what.gains, joints),
        "kp": size.kp * factors(what.gains, joints),
        "kv": size.kv * factors(what.gains, joints),
        "armature": own["armature"] * factors(what.friction, joints),
        "viscous": own["viscous"] * factors(what.friction, joints),
        "coulomb": own["coulomb"] * factors(what.friction, joints),
        "mass": masses * ratio,
        "mass_ratio": ratio,
        "total_mass": float(masses @ ratio),
        "foot_offset": sphere,
        "feet": np.array([foot.centre for foot in size.feet]) + sphere,
        "zeros": what.zeros * rng.uniform(-1, 1, joints),
        "gyro_bias": what.imu_bias * rng.uniform(-1, 1, 3),
        "accelerometer_bias": 10 * what.imu_bias * rng.uniform(-1, 1, 3),
    }
    return truth


def _scene(robot: Any, legged: Legged, what: WalkingLog, size: Size, truth: dict | None) -> Any:
    """MuJoCo's specification of robot, floor, feet, IMU and motors; nominal without a truth."""
    spec = tree_spec(robot.model, _STEP)
    spec.option.disableflags = 0
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.compiler.degree = False
    own = {name: np.full(len(robot.joints), x) for name, x in size.nominal.items()}
    own |= {"kp": np.full(len(robot.joints), size.kp), "kv": np.full(len(robot.joints), size.kv)}
    own = own if truth is None else truth
    names = list(robot.model.names)[1:]
    if truth is not None:
        for name, ratio in zip(names, truth["mass_ratio"], strict=True):
            body = spec.body(name)
            body.mass *= ratio
            body.inertia = np.array(body.inertia) * ratio
    for k, name in enumerate(robot.joints):
        joint = spec.joint(name)
        joint.armature = own["armature"][k]
        joint.damping = [own["viscous"][k], 0, 0]
        joint.frictionloss = own["coulomb"][k]
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if what.command == "torque":
            motor.gainprm[0] = 1.0 if truth is None else truth["gains"][k]
        else:
            motor.set_to_position(kp=float(own["kp"][k]), kv=float(own["kv"][k]))
    base = spec.body(names[0])
    floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1])
    floor.name = "floor"
    floor.friction = [what.sliding, 0.005, 0.0001]
    floor.solref = [what.soft, 1.0]
    floor.priority = 1
    for k, foot in enumerate(size.feet):
        body = spec.body(names[foot.body])
        kind = mujoco.mjtGeom.mjGEOM_BOX if legged.sole else mujoco.mjtGeom.mjGEOM_SPHERE
        geom = body.add_geom(type=kind, name=foot.name)
        geom.pos = np.asarray(foot.centre) + (0.0 if truth is None else truth["foot_offset"][k])
        if legged.sole:
            geom.size = legged.sole[1]
            geom.pos = np.array(geom.pos) + np.array([0.0, 0.0, legged.sole[1][2]])
        else:
            geom.size = [legged.radius, 0, 0]
    _add_imu(spec, base, legged, what, truth)
    if what.on_stand:
        base.pos = [0.0, 0.0, 2 * size.height]
        if truth is not None:
            held = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name="stand")
            held.objtype = mujoco.mjtObj.mjOBJ_BODY
            held.name1 = names[0]
            held.solref = [0.002, 1.0]
    else:
        base.pos = [0.0, 0.0, size.height]
    return spec


def _add_imu(spec: Any, base: Any, legged: Legged, what: WalkingLog, truth: dict | None) -> None:
    """Adds the IMU's site and sensors; a true one where it really is."""
    imu = base.add_site(name="imu", pos=legged.imu)
    if truth is not None:
        imu.pos = np.array(legged.imu) + what.imu_shift
        quaternion = np.empty(4)
        turn = np.array(what.imu_turn)
        angle = float(np.linalg.norm(turn))
        axis = turn / angle if angle else np.array([1.0, 0, 0])
        mujoco.mju_axisAngle2Quat(quaternion, axis, angle)
        imu.quat = quaternion
    sensors = mujoco.mjtSensor
    for name, kind in (
        ("orientation", sensors.mjSENS_FRAMEQUAT),
        ("gyro", sensors.mjSENS_GYRO),
        ("accelerometer", sensors.mjSENS_ACCELEROMETER),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")


def _simulated(
    robot: Any, legged: Legged, what: WalkingLog, size: Size, spec: Any, truth: dict[str, Any]
) -> tuple[Array, Array, Array]:
    """Rows of the log, contact forces and base poses."""
    rng = np.random.default_rng([what.seed, 2])
    model = spec.compile()
    data = mujoco.MjData(model)
    joints = list(robot.joints)
    at = np.array([model.joint(name).qposadr[0] for name in joints])
    moving = np.array([model.joint(name).dofadr[0] for name in joints])
    every = round(1 / (what.rate * _CONTROL))
    count = round(what.seconds * what.rate)
    ticks = np.arange(count * every + 1) * _CONTROL
    walk = Walk(stance=tuple(size.q), **legged.walk)
    structure = replace(robot.system.structure, contacts=tuple(size.feet))
    system = robot.system.rebuilt(structure, robot.system.space)
    targets = Gait(walk, system, what.seed)(ticks)
    data.qpos[at] = size.q
    data.qpos[:3] = [0.0, 0.0, size.height * (2 if what.on_stand else 1)]
    lag = round(what.late / _CONTROL)
    torques = [np.zeros(len(joints))] * lag
    substeps = round(_CONTROL / _STEP)
    feet = [model.geom(name).id for name in legged.feet]
    held = model.geom(legged.feet[0]).bodyid[0]
    rows = np.empty((count, 1 + 3 * len(joints) + 10))
    forces = np.zeros((count, len(feet), 6))
    base = np.empty((count, 7))
    u = np.zeros(len(joints))
    period = max(round(what.hold / _CONTROL), 1)
    for k in range(count * every):
        logged = k % every == 0
        if what.command == "torque":
            u = size.kp * (targets[k - k % period] - data.qpos[at]) - size.kv * data.qvel[moving]
        elif logged:
            u = targets[k]
        if lag:
            torques.append(u)
            data.ctrl[:] = torques.pop(0)
        else:
            data.ctrl[:] = u
        if logged:
            row = k // every
            mujoco.mj_forward(model, data)
            rows[row, 0] = ticks[k]
            rows[row, 1:] = np.r_[data.qpos[at], data.qvel[moving], u, data.sensordata]
            base[row] = data.qpos[:7]
            forces[row] = _contact_forces(model, data, feet)
        data.xfrc_applied[held, 1] = what.pulled * (ticks[k] % _PULLING > _PULLING * 2 / 3)
        mujoco.mj_step(model, data, substeps)
    return _measured(rows, what, truth, len(joints), rng), forces, base


def _contact_forces(model: Any, data: Any, feet: list[int]) -> Array:
    """(f, 6) wrenches of the ground on the feet, about the centres of their geoms."""
    found = np.zeros((len(feet), 6))
    wrench = np.zeros(6)
    for number in range(data.ncon):
        contact = data.contact[number]
        pair = [int(contact.geom1), int(contact.geom2)]
        for k, geom in enumerate(feet):
            if geom in pair:
                mujoco.mj_contactForce(model, data, number, wrench)
                sign = 1.0 if pair[1] == geom else -1.0
                frame = contact.frame.reshape(3, 3)
                force = sign * frame.T @ wrench[:3]
                found[k, :3] += force
                found[k, 3:] += np.cross(contact.pos - data.geom_xpos[geom], force)
    return found


_DEVIATIONS = {  # of sensors of common walking robots, at noise 1
    "velocity": 0.02,  # [rad/s]
    "orientation": 0.002,  # [rad]
    "gyro": 0.005,  # [rad/s]
    "accelerometer": 0.05,  # [m/s²]
}


def _measured(
    rows: Array, what: WalkingLog, truth: dict[str, Any], joints: int, rng: np.random.Generator
) -> Array:
    """The rows as sensors give them."""
    found = rows.copy()
    q = slice(1, 1 + joints)
    v = slice(1 + joints, 1 + 2 * joints)
    imu = slice(1 + 3 * joints, None)
    late = round(what.imu_late * what.rate)
    if late:
        found[late:, imu] = rows[:-late, imu]
        found[:late, imu] = rows[0, imu]
    found[:, q] -= truth["zeros"]
    if what.bits:
        grain = 2 * np.pi / 2**what.bits
        found[:, q] = grain * np.round(found[:, q] / grain)

    def noise(name: str, width: int) -> Array:
        return what.noise * _DEVIATIONS[name] * rng.standard_normal((len(rows), width))

    found[:, v] += noise("velocity", joints)
    first = 1 + 3 * joints
    turn = np.c_[np.ones(len(rows)), 0.5 * noise("orientation", 3)]
    for row, small in zip(found, turn, strict=True):
        product = np.empty(4)
        mujoco.mju_mulQuat(product, row[first : first + 4], small / np.linalg.norm(small))
        row[first : first + 4] = product
    found[:, first + 4 : first + 7] += noise("gyro", 3) + truth["gyro_bias"]
    found[:, first + 7 :] += noise("accelerometer", 3) + truth["accelerometer_bias"]
    return found


def _header(robot: Any, what: WalkingLog) -> list[str]:
    command = "target" if what.command == "position" else "u"
    joints = [f"{kind}_{name}" for kind in ("q", "dq", command) for name in robot.joints]
    imu = [f"imu_q{x}" for x in "wxyz"] + [f"gyro_{x}" for x in "xyz"] + [f"acc_{x}" for x in "xyz"]
    return ["time", *joints, *imu]


def main() -> None:
    """Writes one log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    kinds = {"str": str, "int": int, "float": float}
    for one in fields(WalkingLog):
        kind = kinds.get(str(one.type).split("[")[0])
        if one.name == "command":
            parser.add_argument("--command", choices=["torque", "position"])
        elif one.name == "on_stand":
            parser.add_argument("--on-stand", action="store_const", const=True)
        elif kind:
            parser.add_argument(f"--{one.name.replace('_', '-')}", type=kind)
    given = {name: x for name, x in vars(parser.parse_args()).items() if x is not None}
    folder = given.pop("folder")
    found = walked(replace(WalkingLog(), **given), folder)
    print(f"{found.log} with {found.model}; upright: {found.upright}")


if __name__ == "__main__":
    main()
