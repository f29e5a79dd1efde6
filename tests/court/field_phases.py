"""Logs with phases in which the structure does not hold, drawn from a seed, and what is true.

A plant with hidden parameters is simulated from rest, twice: two motions of one robot. Before,
between and after them stand phases that no structure contains: rest on the ground, a crash, a
controller that pauses, a hand that moves an arm. Sensor noise is added to the whole. Contact with
a table is the torque that a stiff arm exerts against it for a second, along an undisturbed motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation, Slerp

from nsaid_mj.clinic.logs.layout import pose_velocity
from nsaid_mj.core.log import Log
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.arm import true_model
from nsaid_mj.lab.setup import Setup

FLYING = ("hummingbird", "crazyflie")
FLOATING = ("bluerov2", "uvms", "remus100", "catamaran", "f1tenth", "bmw320i")
ARMS = ("ur5", "panda", "xarm7", "z1")
KINDS = {
    "healthy": (*FLYING, *FLOATING, *ARMS),
    "gentle": ("hummingbird", "crazyflie", "bluerov2", "uvms"),
    "ground": (*FLYING, *FLOATING),
    "spinning": FLYING,
    "armed column": (*FLYING, *FLOATING),
    "after": FLOATING,
    "twice": (*FLYING, *FLOATING),
    "carried": FLYING,
    "crash": FLYING,
    "pause": ARMS,
    "hand": ARMS,
    "contact": ARMS,
}
"""Robots of every kind of log."""

_SECOND = ("twice", "pause", "hand")  # kinds with two motions
_RATE = 100.0  # rows per second


@dataclass
class Drawn:
    """A log and what is true of it.

    Attributes:
        kind: of `KINDS`.
        model: name of the robot.
        log: path of the file.
        lock: joints that do not move.
        out: start and end [s] of every part in which the structure does not hold.
        total: duration [s].
        truth: the robot's true parameters by name; arms' commands are those of its motors.
    """

    kind: str
    model: str
    log: Path
    lock: list[str]
    out: list[tuple[float, float]]
    total: float
    truth: dict[str, float]


class FromRest(Driver):
    """A driver whose robot starts at rest."""

    def __init__(self, driver: Driver):
        self._driver = driver

    def start(self) -> tuple[Array, Array]:
        """The driver's position, and rest."""
        q, v = self._driver.start()
        return q, np.zeros_like(v)

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) the driver's."""
        return self._driver.command(t, q, v)


def draw(seed: int, folder: Path, kind: str | None = None, model: str | None = None) -> Drawn:
    """Draws a log, of a kind and a robot if they are given, and writes it into a folder."""
    rng = np.random.default_rng([seed, 47])
    kind = kind or str(rng.choice(list(KINDS)))
    model = model or str(rng.choice(KINDS[kind]))
    arm = model in ARMS
    seconds = float(rng.uniform(10, 16)) * (2.0 if model in FLOATING else 1.0)
    scenario = replace(load(model), seed=seed, sensors="ideal", duration=seconds)
    steps = int(np.ceil(1 / (_RATE * scenario.dt)))  # of the simulation, in one of the log
    scenario = replace(scenario, dt=1 / (_RATE * steps))
    setup = Setup.of(scenario)
    first = _gentle(setup, model in FLYING, rng) if kind == "gentle" else _run(setup, 0, seconds)
    parts = [first, _run(setup, 1, seconds) if kind in _SECOND else first]
    made = _Joined(setup.system, arm)
    _assemble(made, kind, parts, rng)
    if kind == "contact":
        _touch(made, setup, rng)
    return _written(made, setup, rng, kind, model, folder)


def _run(setup: Setup, which: int, seconds: float) -> Log:
    """A motion of the robot from rest, at the log's rate."""
    scenario = replace(setup.scenario, seed=setup.scenario.seed + 1000 * which)
    return _followed(setup, FromRest(replace(setup, scenario=scenario).driver()), seconds)


def _followed(setup: Setup, driver: Driver, seconds: float) -> Log:
    dt = setup.scenario.dt
    with setup.plant.running():
        log = setup.plant.trajectory(driver, round(seconds / dt))
    every = max(1, round(1 / (_RATE * dt)))
    return Log(*(part[::every] for part in log))


class _Joined:
    """A log that grows by parts, with the spans in which the structure does not hold."""

    def __init__(self, system, arm: bool):
        self.system = system
        self.arm = arm
        self.q: list[Array] = []
        self.v: list[Array] = []
        self.u: list[Array] = []
        self.armed: list[Array] = []
        self.out: list[tuple[float, float]] = []
        self.count = 0

    @property
    def last(self) -> Array:
        return self.q[-1][-1]

    def add(self, q: Array, v: Array, u: Array, holds: bool, armed: bool = True) -> None:
        if not holds:
            a, b = self.count / _RATE, (self.count + len(q)) / _RATE
            if self.out and abs(self.out[-1][1] - a) < 1e-9:
                a = self.out.pop()[0]
            self.out.append((a, b))
        self.count += len(q)
        self.q.append(q)
        self.v.append(v)
        self.u.append(u)
        self.armed.append(np.full(len(q), float(armed)))

    def rest(self, pose: Array, u: Array, seconds: float, armed: bool = False) -> None:
        count = round(seconds * _RATE)
        q = np.repeat(pose[None], count, axis=0)
        commands = u if u.ndim == 2 else np.repeat(u[None], count, axis=0)
        self.add(q, np.zeros((count, self.system.n)), commands[:count], False, armed)

    def stop(self, speed: Array, pose: Array, u: Array, seconds: float) -> None:
        """From a velocity to rest at a pose, as something else brakes it."""
        count = max(3, round(seconds * _RATE))
        share = np.linspace(0, 1, count)
        q = between(self.system, self.last, pose, share)
        v = speed * (1 - share)[:, None] ** 2
        self.add(q, v, np.repeat(u[None], count, axis=0), False)

    def motion(self, log: Log) -> None:
        q = log.q
        if self.q and not self.arm:
            q = q.copy()
            free = 3 if self.system.m - self.system.n == 1 or self.system.group == 6 else 2
            q[:, :free] += self.last[:free] - q[0, :free]
        self.add(q, log.v, log.u, True)


def between(system, a: Array, b: Array, share: Array) -> Array:
    """(N, m) poses on the way from one to another."""
    q = a + share[:, None] * (b - a)
    if system.group == 6:
        ends = Rotation.from_quat([a[3:7], b[3:7]])
        q[:, 3:7] = Slerp([0, 1], ends)(share).as_quat()
    return q


def _assemble(made: _Joined, kind: str, parts: list[Log], rng: np.random.Generator) -> None:
    first, second = parts
    off = np.zeros(first.u.shape[1])
    long = float(rng.uniform(3, 12))
    if kind in ("ground", "armed column", "spinning"):
        made.rest(_placed(made, first.q[0]), off, long)
        if kind == "spinning":
            top = np.abs(first.u[: len(first.u) // 4]).mean(axis=0)
            count = round(_RATE * rng.uniform(1, 4))
            rise = rng.uniform(0.3, 0.6) * np.ones(count)
            made.rest(first.q[0], rise[:, None] * top, count / _RATE, armed=True)
        made.motion(first)
        return
    if kind == "carried":
        _carried(made, first.q[0], off, rng)
    made.motion(first)
    if kind in ("healthy", "gentle", "contact", "carried"):
        return
    speed = first.v[-1]
    if kind == "crash":
        fallen = _turned(first.q[-1], rng)
        made.stop(3.0 * rng.standard_normal(len(speed)) + speed, fallen, first.u[-1], 0.5)
        if rng.random() < 0.5:
            jitter = first.u[-100:] * rng.uniform(0.2, 0.6)
            made.rest(fallen, jitter, 1.0, armed=True)
        made.rest(fallen, off, float(rng.uniform(2, 8)))
        return
    if kind == "pause":
        made.stop(speed, first.q[-1] + 0.05 * speed, first.u[-1], 0.25)
        made.rest(made.last, first.u[-1], float(rng.uniform(1, 4)))
        _led(made, second.q[0], first.u[-1], 0.6 + rng.random())
        made.motion(second)
        return
    if kind == "hand":
        made.stop(speed, first.q[-1] + 0.05 * speed, off, 0.25)
        for _ in range(2):
            there = 0.5 * (made.last + second.q[0]) + 0.4 * rng.standard_normal(len(off))
            _led(made, there, off, float(rng.uniform(1, 2)))
        _led(made, second.q[0], off, float(rng.uniform(1, 2)))
        made.motion(second)
        return
    made.stop(speed, _level(made, first.q[-1]), 0.5 * first.u[-1], float(rng.uniform(0.2, 0.4)))
    made.rest(made.last, off, long)
    if kind == "twice":
        made.rest(_placed(made, second.q[0]), off, 1.0)
        made.motion(second)


def _led(made: _Joined, pose: Array, u: Array, seconds: float) -> None:
    """A smooth motion to a pose by something that is not a motor."""
    s = np.linspace(0, 1, max(10, round(seconds * _RATE)))
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    q = made.last + share[:, None] * (pose - made.last)
    v = np.gradient(q, 1 / _RATE, axis=0)
    made.add(q, v, np.repeat(u[None], len(q), axis=0), False)


def _carried(made: _Joined, pose: Array, off: Array, rng: np.random.Generator) -> None:
    """From where it lay to the place of its take-off, in somebody's hand, motors off."""
    there = pose.copy()
    there[:3] += rng.uniform(-3, 3, 3)
    made.rest(_turned(there, rng), off, 1.0)
    s = np.linspace(0, 1, round(_RATE * rng.uniform(3, 6)))
    q = between(made.system, made.last, pose, 10 * s**3 - 15 * s**4 + 6 * s**5)
    made.add(q, pose_velocity(q, _RATE), np.repeat(off[None], len(q), axis=0), False, False)
    made.rest(pose, off, 1.0)


def _placed(made: _Joined, pose: Array) -> Array:
    if not made.q:
        return pose
    found = pose.copy()
    free = 3 if made.system.group == 6 else 2
    found[:free] = made.last[:free]
    return found


def _level(made: _Joined, pose: Array) -> Array:
    """The pose without roll and pitch."""
    if made.system.group != 6:
        return pose
    found = pose.copy()
    yaw = Rotation.from_quat(pose[3:7]).as_euler("ZYX")[0]
    found[3:7] = Rotation.from_euler("Z", yaw).as_quat()
    return found


def _turned(pose: Array, rng: np.random.Generator) -> Array:
    found = pose.copy()
    turn = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3))
    found[3:7] = (Rotation.from_quat(pose[3:7]) * turn).as_quat()
    return found


def _gentle(setup: Setup, flying: bool, rng: np.random.Generator) -> Log:
    """A slow motion after a few seconds: a rotorcraft hovers, others creep or drift to rest."""
    driver = setup.driver()
    share = float(rng.uniform(0.1, 0.3))

    class Slow(FromRest):
        def command(self, t: float, q: Array, v: Array) -> Array:
            u = driver.command(t, q, v)
            return u if flying or t < 5 else share * u

    return _followed(setup, Slow(driver), setup.scenario.duration)


def _touch(made: _Joined, setup: Setup, rng: np.random.Generator) -> None:
    """A force on the last link for half a second to one and a half, held by the motors."""
    system = setup.system
    assert isinstance(system, JointTree)
    model = true_model(system.model, setup.plant.truth)
    data = model.createData()
    count = round(_RATE * rng.uniform(0.5, 1.5))
    begin = int(rng.uniform(0.2, 0.8) * (made.count - count))
    t = np.linspace(0, 1, count)
    profile = np.minimum(1, np.minimum(t, 1 - t) / 0.1)
    pull = np.r_[rng.standard_normal(3), np.zeros(3)]
    weight = sum(i.mass for i in list(model.inertias)[1:]) * 9.81
    pull *= rng.uniform(0.2, 0.6) * weight / np.linalg.norm(pull)
    gain = setup.plant.truth[system.space["motor gain"]]
    q, u = made.q[0], made.u[0].copy()
    for k in range(count):
        J = pin.computeJointJacobian(model, data, q[begin + k], model.njoints - 1)
        pin.forwardKinematics(model, data, q[begin + k])
        R = data.oMi[model.njoints - 1].rotation
        u[begin + k] -= profile[k] * (J.T @ np.r_[R.T @ pull[:3], np.zeros(3)]) / gain
    made.u[0] = u
    made.out.append((begin / _RATE, (begin + count) / _RATE))


def _written(
    made: _Joined, setup: Setup, rng: np.random.Generator, kind: str, model: str, folder: Path
) -> Drawn:
    """The log as a file, with the sensors' noise."""
    q, v, u = (np.concatenate(part) for part in (made.q, made.v, made.u))
    system = setup.system
    noise = setup.scenario.noise
    v = v + noise.velocity * rng.standard_normal(v.shape)
    turns = slice(3, 7) if system.group == 6 else slice(0, 0)
    kept = q[:, turns].copy()
    q = q + noise.position * rng.standard_normal(q.shape)
    if system.group == 6:
        small = Rotation.from_rotvec(noise.position * rng.standard_normal((len(q), 3)))
        q[:, turns] = (Rotation.from_quat(kept) * small).as_quat()
    t = np.arange(len(q)) / _RATE
    lock: list[str] = []  # other fingers mimic the first
    if made.arm:
        names = [str(name) for name in system.joint_names]
        lock = [name for name in names if "finger" in name or "gripper" in name.lower()]
        table = {"time": t}
        for k, name in enumerate(names):
            if name not in lock:
                table[f"{name}_position"] = q[:, k]
                table[f"{name}_velocity"] = v[:, k]
                table[f"{name}_current"] = u[:, k]
    else:
        table = {"t": t}
        for letter, part in zip("qvu", (q, v, u), strict=True):
            table |= {f"{letter}_{k}": column for k, column in enumerate(part.T)}
        if kind == "armed column":
            table["armed"] = np.concatenate(made.armed)
    path = folder / f"{kind.replace(' ', '_')}.csv"
    columns = np.column_stack(list(table.values()))
    np.savetxt(path, columns, delimiter=",", header=",".join(table), comments="", fmt="%.9g")
    truth = dict(zip(system.space.names, setup.plant.truth.tolist(), strict=True))
    return Drawn(kind, model, path, lock[:1], made.out, float(t[-1]), truth)
