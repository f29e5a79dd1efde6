"""Physically consistent inertias: those of bodies with a nonnegative mass density.

With Σ = ½ tr(I) 1 − I, the second moments of mass about the centre of mass, a body of mass m > 0
and inertia I exists if and only if Σ ⪰ 0; the principal moments then satisfy the triangle
inequality.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..base import Finding, pin
from ..core import Array, rounded
from .errors import BadRobot

_INSIDE = 1e-6  # least ratio of the smallest to the largest second moment that stays unchanged
_FLATNESS = 0.02  # least ratio after a change
_THINNESS = 0.05  # least standard deviation of mass after a change, over the link's size
_LIGHTNESS = 1e-3  # mass given to a massless link, over that of the robot
_UNKNOWN_MASS = 0.1  # if nothing in the file gives a clue [kg, m]
_UNKNOWN_SIZE = 0.1
_SMALLEST = 1e-3  # least length that says something about a link's size [m]


def is_physical(mass: float, inertia: Array) -> bool:
    """Whether a body can have this mass [kg] and this inertia (3, 3) about its centre of mass."""
    moments = np.linalg.eigvalsh(_second_moments(inertia))
    return bool(mass > 0 and moments[-1] > 0 and moments[0] > _INSIDE * moments[-1])


def moved_inside(mass: float, inertia: Array, size: float) -> Array:
    """The nearest inertia (3, 3) that a body can have, with some margin [kg·m²].

    Second moments of mass about the centre of mass are raised to at least 2 % of the largest one,
    and to those of mass [kg] spread over 5 % of the link's size [m].
    """
    moments, axes = np.linalg.eigh(_second_moments(inertia))
    floor = max(_FLATNESS * moments[-1], mass * (_THINNESS * size) ** 2)
    sigma = axes @ np.diag(np.maximum(moments, floor)) @ axes.T
    return np.trace(sigma) * np.eye(3) - sigma


def make_physical(model: pin.Model, names: list[str]) -> list[Finding]:
    """Moves a model's unphysical inertias inside the cone, in place, with a warning for each.

    A massless link gets a thousandth of the robot's mass, at its joint; if no link has a mass, each
    gets one that is spread over the length of the longest, and there is a warning more,
    `no_masses`.
    """
    findings = []
    total = sum(max(inertia.mass, 0.0) for inertia in list(model.inertias)[1:])
    reach = max((_size(model, i) for i in range(1, model.njoints)), default=0.0)
    for i in range(1, model.njoints):
        before = pin.Inertia(model.inertias[i])  # a copy, not a view
        if is_physical(before.mass, before.inertia):
            continue
        if before.mass > 0:
            mass = before.mass
            lever = before.lever
            about = moved_inside(mass, before.inertia, _size(model, i))
        else:
            mass = _LIGHTNESS * total
            lever = np.zeros(3)
            about = moved_inside(mass, np.zeros((3, 3)), _size(model, i))
            if not total > 0:
                mass = _UNKNOWN_MASS
                about = 2 * _UNKNOWN_MASS * (0.5 * reach) ** 2 * np.eye(3)
        after = model.inertias[i] = pin.Inertia(mass, lever, about)
        findings.append(moved(names[i - 1], (before.mass, before.inertia), (mass, after.inertia)))
    if not total > 0:
        text = "no moving link has a mass: all inertias are guesses, and their scale is arbitrary"
        remedy = "Add <inertial> to the model file, or give a gain with --known."
        findings.append(Finding("warning", "no_masses", "", text, remedy))
    return findings


def check_inertias(name: str, model: pin.Model) -> None:
    """Checks that links have positive mass and moments that satisfy the triangle inequality.

    Raises:
        BadRobot: names the first link whose inertia no body can have.
    """
    for i in range(1, model.njoints):
        part = f"link of joint {model.names[i]}"
        inertia = model.inertias[i]
        if not np.isfinite(inertia.toDynamicParameters()).all():
            raise BadRobot(name, part, "its inertia is not finite", "Correct the URDF.")
        if inertia.mass <= 0:
            remedy = "Give it an <inertial> of mass > 0."
            raise BadRobot(name, part, f"its mass is {inertia.mass:g} kg", remedy)
        moments = np.linalg.eigvalsh(inertia.inertia)
        if moments[0] <= 0 or moments[0] + moments[1] < moments[2] * (1 - 1e-6):
            reason = f"no body has the principal moments {_listed(moments)} kg·m²"
            remedy = (
                "Correct <inertia>: each must be positive and at most the sum of the other two."
            )
            raise BadRobot(name, part, reason, remedy)


def moved(link: str, before: tuple[float, Array], after: tuple[float, Array]) -> Finding:
    """The finding about a link whose mass [kg] and inertia (3, 3) [kg·m²] were changed."""
    old, about = before
    new, changed = after
    was = np.linalg.eigvalsh(about)
    now = np.linalg.eigvalsh(changed)
    wrong = f"moments of inertia of {_listed(was)} kg·m² are not physical at {rounded(old)} kg"
    given = f"{_listed(now)} kg·m² are used"
    if old != new:
        wrong = "it moves, but has no mass"
        given = f"it was given {rounded(new)} kg and moments of inertia {_listed(now)} kg·m²"
    data = {
        "mass_before": float(old),
        "mass_after": float(new),
        "moments_before": was.tolist(),
        "moments_after": now.tolist(),
    }
    remedy = "If better values are known, correct <inertial> in the model file."
    return Finding("warning", "inertia_moved", f"link {link}", f"{wrong}; {given}", remedy, data)


def _second_moments(inertia: Array) -> Array:
    """(3, 3) Σ of an inertia (3, 3)."""
    return 0.5 * np.trace(inertia) * np.eye(3) - inertia


def _size(model: pin.Model, joint: int) -> float:
    """A link's size [m], from its centre of mass and the joints on it."""
    children = [i for i in range(1, model.njoints) if model.parents[i] == joint]
    levers = [model.inertias[joint].lever] if model.inertias[joint].mass > 0 else []
    levers += [model.jointPlacements[i].translation for i in children]
    return plausible_size(float(np.linalg.norm(lever)) for lever in levers)


def plausible_size(lengths: Iterable[float]) -> float:
    """The largest of some lengths on a link as its size; 0.1 m if they are too small."""
    size = max(filter(np.isfinite, lengths), default=0.0)
    return size if size > _SMALLEST else _UNKNOWN_SIZE


def _listed(values: Iterable[float]) -> str:
    """Values in words; once if all are equal."""
    words = [rounded(value) for value in values]
    return words[0] if len(set(words)) == 1 else ", ".join(words)
