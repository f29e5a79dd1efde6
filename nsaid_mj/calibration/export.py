"""Calibrated model files of an identification."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import NsaidError
from ..parameters import Array, number
from ..robot.findings import Finding
from ..robot.identified import Coupling, Identified, Spring, with_inertias
from ..robot.mjcf_export import write_mjcf
from ..robot.tables import write_sysid, write_table
from ..robot.urdf import write_urdf
from .joints import joint_of
from .replay import replay
from .result import Identification


def write_models(result: Identification, folder: Path) -> tuple[list[Path], list[Finding]]:
    """Writes the calibrated model, in all formats that can represent it, into an existing folder.

    Returns the files, and the deviation of the exported model from the log.
    """
    robot, files = result.robot, [folder / "calibrated.yaml"]
    write_parameters(result, files[0])
    if robot.model is None:
        return files, []
    values = identified(result)
    if robot.kind == "urdf":
        files.append(folder / f"{_file_name(robot.name)}.urdf")
        write_urdf(robot, values, files[-1])
    files.append(folder / f"{_file_name(robot.name)}.xml")
    write_mjcf(robot, values, files[-1])
    files.append(folder / "sysid.yaml")
    write_sysid(robot, values, files[-1])
    return files, [_followed(result, values)]


def write_parameters(result: Identification, path: Path) -> None:
    """Writes parameters with units, 95 % intervals and status, and the scale's anchor, as YAML."""
    parameters = [
        {
            "name": p.label,
            "value": float(p.value),
            "unit": p.unit,
            "interval": [float(p.low), float(p.high)],
            "status": p.status,
        }
        for p in result.parameters
    ]
    table = {"robot": result.robot.name, "anchor": result.anchor, "notes": _notes(result)}
    write_table(path, {**table, "parameters": parameters})


def _notes(result: Identification) -> list[str]:
    """The verdict and the warnings."""
    return [result.verdict, *(f.text for f in result.findings if f.level == "warning")]


def identified(result: Identification) -> Identified:
    """The values of a tree of joints for the exporters.

    Files hold viscous and Coulomb friction only: where further friction columns were identified,
    the least-squares approximation of the friction along the log.
    """
    robot = result.robot
    k = len(robot.joints)
    links = result.theta[: 10 * (robot.model.njoints - 1)].reshape(-1, 10)
    model = with_inertias(robot.model, links, _of(result, "rotor inertia", k))
    damping, friction = result.friction
    speed = np.array([joint.friction_speed for joint in result.joints])
    gain = _of(result, "motor gain", k) * np.sign(robot.gain)
    couplings = tuple(
        Coupling((i, j), sign, *(p.value for p in result.of(f"coupling of {a} and {b}")))
        for i, j, sign in result.fitted.coupled
        for a, b in [(robot.joints[i], robot.joints[j])]
    )
    return Identified(
        model, damping, friction, speed, gain, result.anchor, tuple(_notes(result)), couplings,
        tuple(_springs(result)),
    )  # fmt: skip


def _springs(result: Identification) -> Iterator[Spring]:
    """The springs among the chosen columns; a joint's offset gives the spring's rest position."""
    value = {p.name: p.value for p in result.parameters}
    for j, joint in enumerate(result.joints):
        if "spring" in joint.columns:
            stiffness = value[f"stiffness_{j + 1}"]
            yield Spring(j, stiffness, -value[f"offset_{j + 1}"] / stiffness)


def _file_name(name: str) -> str:
    """A robot's name as the name of a file."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "robot"


def _of(result: Identification, block: str, k: int) -> Array:
    """(k,) parameters of a block of at most one per joint; 0 for joints without."""
    values = np.zeros(k)
    for parameter in result.of(block):
        values[joint_of(parameter.name)] = parameter.value
    return values


def _followed(result: Identification, values: Identified) -> Finding:
    """Deviation of the exported model from the log, compared with the original model file."""
    try:
        exported, nominal = (
            replay(result.robot, own, result.recordings)
            for own in (values, Identified.nominal(result.robot))
        )
    except NsaidError as error:
        return Finding("note", "replay", "", f"the exported model was not simulated: {error}")
    rows = list(zip(result.robot.joints, exported, nominal, strict=True))
    figures = ", ".join(f"{name} {_figure(own)} ({_figure(file)})" for name, own, file in rows)
    worse = ", ".join(name for name, own, file in rows if own > file)
    text = (
        "rms error of MuJoCo over windows of 0.2 s, driven by the log's commands [rad or m], with "
        f"the exported model (in brackets: with the original model file): {figures}"
    )
    remedy = f"The exported model is worse at {worse}." if worse else ""
    data = {"exported": exported.tolist(), "nominal": nominal.tolist()}
    return Finding("warning" if worse else "note", "replay", "", text, remedy, data)


def _figure(value: float) -> str:
    return number(value, significant=2) if math.isfinite(value) else "diverges"
