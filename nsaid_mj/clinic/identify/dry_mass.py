"""The weighed mass of a vehicle in water: what it says of the effective masses, and the added mass.

The entries of the mass matrix are m + added mass, and no motion tells the two apart. The mass m,
which a balance tells, fixes the common scale as far as the added mass of the sheet does: the
effective masses of the sheet are corrected by the difference of both masses, and their own spread
remains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base import Finding, InvalidInput
from ...core import ParameterSpace, number
from ...lab import INTERVAL
from ...report import Parameter
from ...robots import RobotModel, with_inertias
from .links import file_links

NAMES = ("m", "mass", "dry mass", "total mass")
"""What a user may call it in `--known`."""

_NEAR = 1.25  # of a model file's mass: batteries and loads that the file lacks, and then some
_SPREAD = 0.3  # standard deviation of the logarithm of a sheet's added mass


def of_parameters(robot: RobotModel, known: Mapping[str, float]) -> dict[str, float]:
    """Known values of parameters, without a vehicle's dry mass, which the structure contains."""
    return {x: v for x, v in known.items() if not (robot.weighed and x in NAMES)}


def stated_mass(robot: RobotModel, known: Mapping[str, float]) -> float | None:
    """The dry mass among known values; None if there is none, or the sheet has no added mass."""
    own = robot.system.space if robot.dry_mass is not None or robot.floating else None
    if own is None:
        return None
    given = [known[name] for name in NAMES if name in known and name not in own.names]
    return given[0] if given else None


def off_file(robot: RobotModel, mass: float) -> float:
    """Standard deviation of the scale of a walking robot of a told mass [kg] far from its file's.

    0 within `_NEAR`: one of the two is wrong, and the interval then reaches from one to the other.
    """
    if not robot.floating:
        return 0.0
    off = abs(float(np.log(mass / file_links(robot.model)[::10].sum())))
    return off / INTERVAL if off > np.log(_NEAR) else 0.0


def with_dry_mass(robot: RobotModel, mass: float) -> RobotModel:
    """The vehicle of that dry mass [kg], whose effective masses of the sheet are corrected by it.

    Raises:
        InvalidInput: it is no number > 0, or far from the sheet's, whose inertias then do not fit.
    """
    if robot.floating:
        links = file_links(robot.model)
        whole = float(links[::10].sum())
        heavier = with_inertias(robot.model, links.reshape(-1, 10) * mass / whole, robot.rotor)
        findings = robot.findings
        if off_file(robot, mass):
            text = (
                f"the given {mass:.3g} kg are {mass / whole:.2g} times the {whole:.3g} kg of the "
                "model file; all gains, frictions and inertias follow it, and no motion checks it"
            )
            remedy = "Weigh the robot as it was during the log, or correct the file."
            findings += (Finding("warning", "told_mass", "mass", text, remedy),)
        return replace(robot, model=heavier, weighed=True, findings=findings)
    assert robot.prior is not None  # every vehicle has one
    assert robot.dry_mass is not None
    if not 0.5 * robot.dry_mass < mass < 2 * robot.dry_mass:
        expected = f"kilograms near the sheet's {robot.dry_mass:g}"
        remedy = "Give the mass without water, or correct the sheet."
        raise InvalidInput("--known m", expected, mass, remedy)
    prior = robot.prior.copy()
    prior[effective_masses(robot.system.space)] += mass - robot.dry_mass
    return replace(robot, prior=prior, dry_mass=mass, weighed=True)


def effective_masses(space: ParameterSpace) -> list[int]:
    """Indices of the masses of a mass matrix, one for each direction of motion."""
    pairs = zip(space.labels, space.units, strict=True)
    return [k for k, (x, u) in enumerate(pairs) if x.startswith("effective ") and u == "kg"]


def scale_deviation(robot: RobotModel) -> float:
    """Standard deviation of the logarithm of a weighed vehicle's effective masses."""
    assert robot.prior is not None  # every vehicle has one
    masses = robot.prior[effective_masses(robot.system.space)]
    added = masses - (robot.dry_mass or 0.0)
    return float(max(_SPREAD * added.sum() / masses.sum(), 0.01))


def added_mass(robot: RobotModel, parameters: Sequence[Parameter]) -> list[Finding]:
    """A note of the added masses, effective minus dry mass, with their intervals."""
    if robot.dry_mass is None:
        return []
    own = effective_masses(robot.system.space)
    found = []
    values = {}
    for parameter in (parameters[k] for k in own):
        way = parameter.label.removeprefix("effective ").removesuffix(" mass")
        ends = [x - robot.dry_mass for x in (parameter.value, parameter.low, parameter.high)]
        ends = [max(x, 0.0) for x in ends]  # water takes no mass away
        values[way] = ends
        value, low, high = (number(x, significant=3) for x in ends)
        found.append(f"{way} {value} ({low} to {high})")
    whose = "weighed" if robot.weighed else "sheet's"
    text = f"added mass, effective mass minus the {whose} {robot.dry_mass:g} kg: {', '.join(found)}"
    remedy = "" if robot.weighed else "Give the weighed one, if it differs: --known m=…"
    data = {way: [float(np.round(x, 9)) for x in ends] for way, ends in values.items()}
    return [Finding("note", "added_mass", "", f"{text} kg", remedy, data)]
