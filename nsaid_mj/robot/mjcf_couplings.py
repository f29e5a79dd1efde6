"""Tendons and equality constraints of an MJCF file, which a tree of free joints does not have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ..errors import BadRobot
from .findings import Finding

_TENDON, _OF_JOINTS = mujoco.mjtTrn.mjTRN_TENDON, mujoco.mjtWrap.mjWRAP_JOINT


def check_couplings(robot: str, mj: Any, names: Sequence[str], locked: set[str]) -> list[Finding]:
    """Checks that no equality constraint, and no tendon by a spring or actuator, couples joints.

    Args:
        robot: name or file, for messages.
        mj: MuJoCo's model.
        names: of all joints.
        locked: names of the joints that are locked.

    Returns:
        Warnings of tendons between joints that move which have inertia or friction only, as those
        of a motor that two joints share.

    Raises:
        BadRobot: names the tendon or constraint, and the joints to lock.
    """
    for e in range(mj.neq):
        if mj.eq_active0[e]:
            _refuse(robot, "equality constraint", mj.eq(e).name or str(e),
                    [names[j] for j in sorted(_of_equality(mj, e))], locked)  # fmt: skip
    found = []
    for t in range(mj.ntendon):
        name, joints = mj.tendon(t).name or str(t), [names[j] for j in sorted(_of_tendon(mj, t))]
        if _acts(mj, t):
            _refuse(robot, "tendon", name, joints, locked)
        elif _drags(mj, t) and len(set(joints) - locked) > 1:
            text = (
                f"inertia and friction of this tendon are left out; it couples {', '.join(joints)}"
            )
            remedy = "Name the coupling of the joints in the map."
            found.append(Finding("warning", "tendon", name, text, remedy))
    return found


def _refuse(robot: str, kind: str, name: str, joints: list[str], locked: set[str]) -> None:
    moving = [joint for joint in joints if joint not in locked]
    if moving:
        raise BadRobot(
            robot,
            f"{kind} {name}",
            f"it couples {', '.join(joints)}; only joints that move by themselves can be "
            "identified",
            f"Lock them if they stood still in the log, `--lock {','.join(moving)}`, or remove the "
            f"{kind} from a copy of the file.",
        )


def _of_equality(mj: Any, e: int) -> set[int]:
    """The joints that an equality constraint acts on."""
    kind, one, two = mujoco.mjtEq(mj.eq_type[e]), mj.eq_obj1id[e], mj.eq_obj2id[e]
    if kind == mujoco.mjtEq.mjEQ_JOINT:
        return {int(j) for j in (one, two) if j >= 0}
    if kind == mujoco.mjtEq.mjEQ_TENDON:
        return set().union(*(_of_tendon(mj, t) for t in (one, two) if t >= 0))
    if kind in {mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD}:
        sites = mj.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE
        bodies = [int(mj.site_bodyid[o]) if sites else int(o) for o in (one, two)]
        return _between(mj, bodies)
    return set(range(mj.njnt))  # of flexible bodies


def _acts(mj: Any, t: int) -> bool:
    """Whether a tendon can exert a force on joints at rest."""
    driven = (mj.actuator_trntype == _TENDON) & (mj.actuator_trnid[:, 0] == t)
    taut = np.any(mj.tendon_stiffness[t]) or mj.tendon_limited[t] or driven.any()
    return bool(taut or (_drags(mj, t) and mj.wrap_type[mj.tendon_adr[t]] != _OF_JOINTS))


def _drags(mj: Any, t: int) -> bool:
    """Whether a tendon has inertia or friction."""
    numbers = (mj.tendon_damping, mj.tendon_frictionloss, mj.tendon_armature)
    return any(np.any(x[t]) for x in numbers)


def _of_tendon(mj: Any, t: int) -> set[int]:
    """The joints that change a tendon's length."""
    wraps = range(mj.tendon_adr[t], mj.tendon_adr[t] + mj.tendon_num[t])
    if mj.wrap_type[wraps[0]] == _OF_JOINTS:
        return {int(mj.wrap_objid[w]) for w in wraps}
    bodies = []
    for w in wraps:
        kind = mujoco.mjtWrap(mj.wrap_type[w])
        if kind == mujoco.mjtWrap.mjWRAP_SITE:
            bodies.append(int(mj.site_bodyid[mj.wrap_objid[w]]))
        elif kind in {mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER}:
            bodies.append(int(mj.geom_bodyid[mj.wrap_objid[w]]))
    return _between(mj, bodies)


def _between(mj: Any, bodies: Sequence[int]) -> set[int]:
    """The joints that move some bodies relative to each other."""
    chains = []
    for body in bodies:
        chain, b = set(), body
        while b:
            first = int(mj.body_jntadr[b])
            chain |= set(range(first, first + int(mj.body_jntnum[b])))
            b = int(mj.body_parentid[b])
        chains.append(chain)
    return set().union(*chains) - set.intersection(*chains) if chains else set()
