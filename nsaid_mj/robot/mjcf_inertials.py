"""The `<inertial>` elements of an MJCF, checked before MuJoCo rejects the file for them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..bounds import LARGEST
from ..parameters import Array
from .findings import Finding
from .inertias import moved, moved_inside, plausible_size

_ROWS, _COLUMNS = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]  # places of MuJoCo's fullinertia


def check_inertials(spec: Any) -> list[Finding]:
    """Moves the explicit inertias of a specification inside the cone of physical ones, in place.

    Args:
        spec: MuJoCo's specification.

    Returns:
        A warning for each inertia that was changed.
    """
    findings = []
    for body in spec.bodies:
        full = np.isfinite(body.fullinertia).all()
        about = np.diag(body.inertia)
        if full:
            about[_ROWS, _COLUMNS] = about[_COLUMNS, _ROWS] = body.fullinertia
        if not (body.explicitinertial and body.mass > 0 and _rejected(body, about)):
            continue
        children = [child.pos for child in body.bodies]
        size = plausible_size(float(np.linalg.norm(place)) for place in [body.ipos, *children])
        changed = moved_inside(body.mass, about, size)
        findings.append(moved(body.name, (body.mass, about), (body.mass, changed)))
        if full:
            body.fullinertia = changed[_ROWS, _COLUMNS]
        else:
            body.inertia = changed.diagonal()
    return findings


def _rejected(body: Any, about: Array) -> bool:
    """Whether MuJoCo rejects a body's inertia (3, 3) about its centre of mass."""
    if not (np.abs([body.mass, *about.flat]) <= LARGEST).all():
        return False  # what MuJoCo accepts of these, `check_numbers` refuses
    low, middle, high = np.linalg.eigvalsh(about)
    return low < 0 or low + middle < high or (low <= 0 and len(body.joints) > 0)
