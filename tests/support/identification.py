"""A small identification made by hand: no log is read and nothing is fitted."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pinocchio as pin

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.result import (
    AlongLog,
    Combination,
    Curves,
    GainRatio,
    Identification,
    JointStructure,
    recording_shifts,
    statistics_of,
)
from nsaid_mj.clinic.logs.recordings import LogSegment, Recordings
from nsaid_mj.core.log import Log
from nsaid_mj.lab.loop import Ending
from nsaid_mj.report.result import Parameter, Status
from nsaid_mj.robots.model import RobotModel

INERTIAL = ("mass", "m·cx", "m·cy", "m·cz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
UNITS = ("kg", *["kg·m"] * 3, *["kg·m²"] * 6)
_STATUSES: tuple[Status, ...] = (
    "not excited",
    "only in combination",
    "identified",
    "below the noise",
)


def chain(names: list[str]) -> pin.Model:
    """A chain of revolute joints 0.3 m apart, with alternating axes."""
    model, parent = pin.Model(), 0
    for k, name in enumerate(names):
        joint = pin.JointModelRZ() if k % 2 == 0 else pin.JointModelRY()
        place = pin.SE3(np.eye(3), np.array([0.0, 0.05 * k, 0.3]))
        parent = model.addJoint(parent, joint, place, name)
        model.appendBodyToJoint(parent, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    return model


def identification(
    names: tuple[str, ...] = ("base", "shoulder", "elbow"),
    *,
    explains: str = "yes",
    held_out: float = 0.05,
    validated: bool = False,
    law: bool = False,
    vehicle: bool = False,
    segments: int = 2,
    findings: tuple[Finding, ...] = (),
) -> Identification:
    """An identification of a chain of joints over some seconds.

    Args:
        names: of the joints.
        explains: the verdict.
        held_out: NRMSE of every joint.
        validated: whether there is a validation log.
        law: whether a law has followed the log besides.
        vehicle: whether the robot is a vehicle, whose structure is known but no model file.
        segments: number of logs, all starting at 0 s.
        findings: what was noticed.
    """
    n = len(names)
    model = chain(list(names))
    robot = RobotModel(
        "test arm",
        None,
        "vehicle" if vehicle else "urdf",
        None if vehicle else model,
        names,
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.ones(n),
        np.full(n, np.inf),
        system=load_robot_model("catamaran").system if vehicle else None,
    )
    t = np.arange(0, 4, 0.02)
    q = 0.5 * np.sin(t[:, None] * (1 + np.arange(n)))
    u = np.cos(t[:, None] * (1 + np.arange(n)))
    logs = tuple(
        LogSegment(
            Log(t, q, np.gradient(q, t, axis=0), u),
            np.ones((len(t), n), bool),
            f"log {k}.csv",
            (0, len(t)),
        )
        for k in range(segments)
    )
    recordings = Recordings(logs, 50.0, ("A",) * n)
    parameters = _parameters(names)
    theta = np.array([one.value for one in parameters])
    curves = Curves(
        np.concatenate([t + shift for shift in recording_shifts(recordings)]),
        np.repeat(np.arange(segments), len(t)),
        np.tile(u, (segments, 1)),
        np.tile(u, (segments, 1)) + 0.02,
        np.abs(np.tile(u, (segments, 1))) > 0.1,
    )
    gains = np.arange(len(theta) - n, len(theta))
    along = AlongLog(
        "efficient",
        SimpleNamespace(ending=Ending()),  # type: ignore[arg-type]  # what pages read
        gains,
        np.linspace(0, 4, 8),
        np.linspace(0.5, 1, 8)[:, None] * theta,
        np.full((8, n), 0.1),
        tuple(GainRatio(parameters[k].label, 1.1, 0.2, 1.0, 0.1) for k in gains),
        np.full(n, 0.05),
        np.full(n, 0.04),
        "some",
        1.0,
    )
    joints = tuple(
        JointStructure(
            name,
            0.04,
            held_out,
            0.06,
            0.07 if validated else None,
            0.08 if validated else None,
            ("coulomb", "rotor", "viscous"),
            0.05,
            0.012,
        )
        for name in names
    )
    return Identification(
        explains=explains,  # pyright: ignore[reportArgumentType]
        verdict="The structure explains the log (held-out NRMSE 0.050).",
        parameters=parameters,
        findings=findings,
        robot=robot,
        recordings=recordings,
        joints=joints,
        combinations=(
            Combination("Izz of a link + rotor inertia of a joint", "kg·m²", 1.0, 0.8, 1.2),
        ),
        anchor="the known mass_1 = 2",
        suggestion="One number would help: `--known gain_1=…`.",
        theta=theta,
        deviation=0.1 * np.abs(theta),
        covariance=np.diag(0.01 * theta**2) + 1e-4 * np.outer(theta, theta),
        friction=(np.ones(n), np.ones(n)),
        statistics=statistics_of(joints),
        predictions=curves,
        validation=curves if validated else None,
        law=along if law else None,
        cutoff=8.0,
        seconds=1.5,
        fitted=None,  # type: ignore[arg-type]  # nothing was fitted
    )


def _parameters(names: tuple[str, ...]) -> tuple[Parameter, ...]:
    """Ten inertial parameters per link, then rotor inertia, friction and gain per joint."""
    found = []
    for k in range(len(names)):
        for i, (what, unit) in enumerate(zip(INERTIAL, UNITS, strict=True)):
            status = _STATUSES[(k + i) % 4]
            words = "Izz of a link + rotor inertia of a joint" if status == _STATUSES[1] else ""
            found.append(
                Parameter(
                    f"{what}_{k + 1}",
                    f"{what} of link_{k + 1}",
                    f"link {k + 1}",
                    unit,
                    0.3 + i,
                    0.2,
                    1.1 + i,
                    1.0,
                    status,
                    words,
                )
            )
    for block, letter, unit in (
        ("rotor inertia", "rotor", "kg·m²"),
        ("viscous friction", "viscous", "N·m·s/rad"),
        ("offset", "offset", "N·m"),
        ("motor gain", "gain", "N·m/A"),
    ):
        what = "gain" if letter == "gain" else block
        for k, name in enumerate(names):
            value = -0.1 if letter == "offset" else 2.0 + k
            found.append(
                Parameter(
                    f"{letter}_{k + 1}",
                    f"{what} of {name}",
                    block,
                    unit,
                    value,
                    value - 0.2,
                    value + 0.2,
                    1.0,
                    "identified",
                )
            )
    return tuple(found)
