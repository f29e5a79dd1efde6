"""Small robots and logs of them, as a user would bring them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from nsaid_mj.core import JointTree
from nsaid_mj.robots.model import RobotModel

JOINTS = ("shoulder", "elbow")

LEG = (
    '<body name="{0}_hip" pos="{1} 0 0"><joint name="{0}_abduction" axis="1 0 0"/>'
    '<inertial pos="0 .04 0" mass="1" diaginertia="8e-4 6e-4 7e-4"/>'
    '<body pos="0 .08 0"><joint name="{0}_swing" axis="0 1 0"/>'
    '<inertial pos="0 0 -.08" mass="1.5" diaginertia="7e-3 7e-3 2e-3"/>'
    '<body pos="0 0 -.25"><joint name="{0}_knee" axis="0 1 0"/>'
    '<inertial pos="0 0 -.1" mass=".4" diaginertia="3e-3 3e-3 2e-4"/></body></body></body>'
)
LEGS = ("left", "right")
TWO_LEGS = (
    '<mujoco model="biped"><compiler angle="radian"/><option timestep="1e-3" '
    'integrator="implicitfast"/><default><joint damping=".1" armature=".01" frictionloss=".2"/>'
    "</default><worldbody>"
    + "".join(LEG.format(leg, x) for leg, x in zip(LEGS, (0.2, -0.2), strict=True))
    + "</worldbody><actuator>"
    + "".join(f'<motor joint="{leg}_{j}"/>' for leg in LEGS for j in ("abduction", "swing", "knee"))
    + "</actuator></mujoco>"
)


def two_joints(names: Sequence[str] = JOINTS, limit: float = np.inf) -> RobotModel:
    """A planar arm under gravity with limits ±2.5 rad, 3 rad/s."""
    model = pin.Model()
    model.gravity = pin.Motion(np.array([0, -9.81, 0]), np.zeros(3))
    parent, n = 0, len(names)
    for name in names:
        parent = model.addJoint(
            parent,
            pin.JointModelRZ(),
            pin.SE3(np.eye(3), np.array([0.4 if parent else 0.0, 0, 0])),
            name,
            np.array([100.0]),
            np.array([3.0]),
            np.array([-2.5]),
            np.array([2.5]),
        )
        inertia = pin.Inertia(2.0, np.array([0.2, 0, 0]), 0.02 * np.eye(3))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    return RobotModel(
        name="two_joints",
        source=None,
        kind="urdf",
        model=model,
        joints=tuple(names),
        damping=np.zeros(n),
        friction=np.zeros(n),
        rotor=np.zeros(n),
        gain=np.ones(n),
        limits=np.full(n, limit),
    )


def motion(t: np.ndarray, n: int = 2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth q, v and the torque that an arm of n joints might need, each (N, n)."""
    phases = np.arange(n) + 1.0
    rates = 2 * np.pi * (0.5 + 0.17 * np.arange(n))
    angle = t[:, None] * rates + phases
    q = 0.8 * np.sin(angle) + 0.2 * np.sin(2.3 * angle)
    v = rates * (0.8 * np.cos(angle) + 0.46 * np.cos(2.3 * angle))
    u = 5 * np.sin(q + phases) + 0.8 * v + 2 * np.tanh(v / 0.05)
    return q, v, u


def columns(duration: float = 10.0, rate: float = 200.0, n: int = 2) -> dict[str, np.ndarray]:
    """A clean log as columns t, q1 …, dq1 …, tau1 …"""
    t = np.arange(round(duration * rate)) / rate
    found = {"t": t}
    for name, values in zip(("q", "dq", "tau"), motion(t, n), strict=True):
        found |= {f"{name}{k + 1}": values[:, k] for k in range(n)}
    return found


def write_csv(path: Path, values: dict[str, np.ndarray], delimiter: str = ",") -> Path:
    """Writes columns as text with a header."""
    rows = zip(*(column.tolist() for column in values.values()), strict=True)
    lines = [delimiter.join(values), *(delimiter.join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@dataclass(frozen=True)
class Flaw:
    """What a robot does that its model file does not say.

    Attributes:
        tilt: of the mount about the base's x axis [rad].
        ratio: by joint, factor by which recorded positions are too large.
        zero: by joint, angle that recorded positions are too large by [rad].
        lag: time constant of the motors' force after the command [s].
        delay: (n,) or one, of the motion after the recorded command [s].
        stiction: Stribeck friction beyond Coulomb's, as a share of it.
    """

    tilt: float = 0.0
    ratio: dict[int, float] = field(default_factory=dict)
    zero: dict[int, float] = field(default_factory=dict)
    lag: float = 0.0
    delay: float | tuple[float, ...] = 0.0
    stiction: float = 0.0


def arm_log(
    robot: RobotModel,
    seed: int,
    flaw: Flaw | None = None,
    *,
    duration: float = 20.0,
    rate: float = 200.0,
    fastest: float = 1.5,
    sines: int = 6,
    noise: float = 1e-4,
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """A log of positions and currents by inverse dynamics, and the true values of parameters.

    Every joint moves as a sum of sines of random frequencies, with friction and a rotor that are
    substantial; currents of about 5 A have noise of 0.5 %, and positions that of an encoder.

    Args:
        robot: whose inertias are the truth.
        seed: of motion, gains and noise.
        flaw: of the structure; None for a robot that is what its model says.
        duration: [s].
        rate: rows per second.
        fastest: highest frequency of the motion [Hz].
        sines: per joint; 1 for the motion that tells least.
        noise: of positions [rad].
    """
    flaw, rng, n = flaw or Flaw(), np.random.default_rng([seed, 21]), len(robot.joints)
    lowest = 0.5 * fastest if sines == 1 else 0.1
    rates = 2 * np.pi * rng.uniform(lowest, fastest, (sines, n))
    size, phases = rng.uniform(0.3, 1.0, (sines, n)) / rates, rng.uniform(0, 6.28, (sines, n))
    size *= 1.5 / np.sqrt(np.sum((size * rates) ** 2, axis=0))  # 1 rad/s rms
    constant = rng.uniform(0.7, 1.3, n)
    friction = rng.uniform(0.5, 1.5, (3, n))
    model = pin.Model(robot.model)
    low, high = (getattr(model, f"{side}PositionLimit") for side in ("lower", "upper"))
    middle = 0.5 * (low + high) if model.nq == n and np.isfinite([low, high]).all() else np.zeros(n)
    turn = pin.exp3(np.array([flaw.tilt, 0, 0]))
    model.gravity = pin.Motion(turn @ model.gravity.linear, np.zeros(3))
    data = model.createData()

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = t[:, None, None] * rates + phases
        q = middle + np.sum(size * np.sin(angle), axis=1)
        return (
            q,
            np.sum(size * rates * np.cos(angle), 1),
            -np.sum(size * rates**2 * np.sin(angle), 1),
        )

    def inertial(t: np.ndarray) -> np.ndarray:
        q, v, a = motion(t)
        rows = zip(JointTree.links(model).position(q), v, a, strict=True)
        return np.array([pin.rnea(model, data, *row) for row in rows])

    t = np.arange(round(duration * rate)) / rate
    typical = np.sqrt(np.mean(inertial(t[::20]) ** 2, axis=0))
    typical = np.maximum(typical, 0.05 * typical.max())
    viscous, coulomb, rotor = friction * np.array([[0.15], [0.2], [0.02]]) * typical

    def force(t: np.ndarray) -> np.ndarray:
        _, v, a = motion(t)
        dry = coulomb * (1 + flaw.stiction * np.exp(-((v / 0.1) ** 2))) * np.tanh(v / 0.02)
        return inertial(t) + rotor * a + viscous * v + dry

    delay = np.broadcast_to(flaw.delay, n)
    own = {d: force(t + d) for d in set(delay.tolist())}
    torque = np.column_stack([own[d][:, j] for j, d in enumerate(delay.tolist())])
    if flaw.lag:
        h = 1e-4
        later = np.column_stack([force(t + d + h)[:, j] for j, d in enumerate(delay.tolist())])
        torque = torque + flaw.lag * (later - torque) / h
    constant = constant * typical / 5.0
    u = torque / constant + 0.025 * rng.standard_normal(torque.shape)
    q = motion(t)[0] + noise * rng.standard_normal(torque.shape)
    for j in range(n):
        q[:, j] = flaw.ratio.get(j, 1.0) * q[:, j] + flaw.zero.get(j, 0.0)
    found = {"time": t}
    for j, name in enumerate(robot.joints):
        found |= {f"{name}_position": q[:, j], f"{name}_current": u[:, j]}
    true = {"gain": constant, "rotor": rotor, "viscous": viscous, "coulomb": coulomb}
    return found, {f"{k}_{j + 1}": float(x[j]) for k, x in true.items() for j in range(n)}
