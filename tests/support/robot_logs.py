"""Small robots and logs of them, as a user would bring them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from nsaid_mj.calibration.data import RobotModel

JOINTS = ("shoulder", "elbow")


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
