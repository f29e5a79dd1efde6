"""Identified values as YAML for `mujoco.sysid`."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ..base import OutputFile, pin
from ..core import Array
from .identified import Identified
from .mjcf_export import moving_bodies
from .model import RobotModel

_RANGE = (0.1, 10.0)  # search range of masses and joint parameters, over their values
_STRETCH = (0.5, 2.0)  # of the second moments of mass, over their values
_SHEAR = 0.5  # ± of the other entries of the pseudo-inertia's factor


def write_sysid(robot: RobotModel, values: Identified, path: Path) -> None:
    """Writes a parameter dictionary of `mujoco.sysid`, for the model that `write_mjcf` writes.

    `mujoco.sysid.ParameterDict.load_from_disk` reads it. There are ten numbers `<body>_inertia` for
    every moving body, in the toolbox's log-Cholesky form, and one array each for `rotor`,
    `viscous`, `coulomb` and `gain`, in the order of the robot's joints. As such a file cannot hold
    functions, the modifiers that apply a parameter to a model must be set after reading it.

    Raises:
        InvalidInput: the robot is a vehicle.
    """
    parameters: dict[str, Any] = {}
    for name, inertial in moving_bodies(robot, values):
        theta = log_cholesky(inertial)
        parameters |= _entry(f"{name}_inertia", theta, *_theta_range(theta))
    for name, numbers in (
        ("rotor", values.rotor),
        ("viscous", values.damping),
        ("coulomb", values.friction),
        ("gain", values.gain),
    ):
        ends = np.sort(np.outer(_RANGE, numbers), axis=0)
        parameters |= _entry(name, np.asarray(numbers), ends[0], ends[1])
    write_table(path, parameters)


def log_cholesky(inertial: Array) -> Array:
    """(10,) `mujoco.sysid`'s parameters of a link: α, d (3), s₁₂, s₂₃, s₁₃, t (3).

    With U = e^α [[e^d₁, s₁₂, s₁₃, t₁], [0, e^d₂, s₂₃, t₂], [0, 0, e^d₃, t₃], [0, 0, 0, 1]], the
    pseudo-inertia is U Uᵀ (Rucker and Wensing, IEEE RA-L 7(2), 2022). `inertial` (10,) is about the
    body's frame, in Pinocchio's order.
    """
    P = pin.PseudoInertia.FromDynamicParameters(inertial).toMatrix()
    U = np.linalg.cholesky(P[::-1, ::-1])[::-1, ::-1]
    V = U / U[3, 3]
    d = np.log(V.diagonal()[:3])
    return np.r_[np.log(U[3, 3]), d, V[0, 1], V[1, 2], V[0, 2], V[:3, 3]]


def _theta_range(theta: Array) -> tuple[Array, Array]:
    """Search range of log-Cholesky parameters (10,), that of the toolbox itself."""
    low = np.r_[0.5 * np.log(_RANGE[0]), np.full(3, 0.5 * np.log(_STRETCH[0])), np.full(6, -_SHEAR)]
    high = np.r_[0.5 * np.log(_RANGE[1]), np.full(3, 0.5 * np.log(_STRETCH[1])), np.full(6, _SHEAR)]
    return theta + low, theta + high


def _entry(name: str, value: Array, low: Array, high: Array) -> dict[str, Any]:
    """One parameter as `mujoco.sysid` saves it."""
    numbers = {"nominal": value, "min_value": low, "max_value": high, "value": value}
    content = {key: array.tolist() for key, array in numbers.items()}
    return {name: {"name": name, **content, "frozen": False}}


def write_table(path: Path, table: dict[str, Any]) -> None:
    """Writes a table as YAML, lists of numbers on one line."""
    text = yaml.safe_dump(
        table, sort_keys=False, allow_unicode=True, default_flow_style=None, width=1000
    )
    OutputFile(path).write_text(text)
