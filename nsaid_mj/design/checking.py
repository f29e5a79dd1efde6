"""The last step of a design: the motion is simulated under every draw, and must keep its limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..control import DriverConfig
from ..errors import NoMotion
from ..log import Log
from ..parameters import Array
from ..system import SecondOrderSystem
from .experiment import Experiment
from .limits import Limits, coordinates_of, extents_of
from .motions import DrivenMotions, JointMotions

_SHRINK = 0.98  # of a joint that breaks a limit, beyond what its use says
_ATTEMPTS = 12  # smaller versions of an arm's motion
_ALONE = 3  # of them in which only joints that break a limit are made smaller, and then all
_ALL = 0.8  # share of every joint that is left at each of the others
_STARTED = 0.5
# from which on the acceleration counts [s]: before, the loop takes hold of an arm whose weight it
# does not know exactly, however small the motion
_SMALLER = 0.9  # amplitudes of a vehicle's commands at a second attempt

Motions = JointMotions | DrivenMotions
"""The candidates of a search."""


def checked(
    motions: Motions, candidates: Sequence[Array], limits: Limits
) -> tuple[DriverConfig, tuple[Log, ...], dict[str, float]]:
    """The driver of a candidate whose simulations under all draws keep all limits.

    The best candidate comes first. That of an arm is made smaller until it keeps the limits, first
    the joints that break one, then all, as light joints are moved by the others; of a vehicle's,
    the first that keeps them is taken, as it is or with smaller commands.

    Raises:
        NoMotion: all break one.
    """
    least, entries = {"stability": np.inf}, {}
    share = np.ones(motions.experiment.system.n)
    for attempt in range(_ATTEMPTS if isinstance(motions, JointMotions) else 2 * len(candidates)):
        if isinstance(motions, JointMotions):
            driver: DriverConfig = motions.driver(candidates[0], share)
        else:
            driver = motions.driver(candidates[attempt // 2], (1.0, _SMALLER)[attempt % 2])
        logs, worst = _simulated(motions.experiment, driver, limits)
        if worst is None:
            share = 0.8 * share
            continue
        uses = {name: float(use.max()) for name, use in worst.items()}
        touched = _touched(motions, logs)
        if max(uses.values()) <= 1 and not touched:
            return driver, logs, uses
        if touched:
            uses["contacts"] = np.inf
            share = 0.9 * share
        if max(uses.values()) < max(least.values()):
            least, entries = uses, worst
        if isinstance(motions, JointMotions):
            joint = np.max(list(worst.values()), axis=0)
            share = share * np.where(joint > 1, _SHRINK / np.minimum(joint, 1.5), 1.0)
            share = share * (1.0 if attempt < _ALONE else _ALL)
    name = max(least, key=lambda name: least[name])
    if not np.isfinite(least[name]):
        raise NoMotion(
            f"every motion that was checked breaks the limit of {name}",
            "Restrict the positions to a pose with more room around it, or give more --effort.",
        )
    raise NoMotion(*_binding(motions.experiment.system, limits, name, entries[name]))


def _binding(system: SecondOrderSystem, limits: Limits, name: str, use: Array) -> tuple[str, str]:
    """What binds, and what to do about it."""
    worst, limit = int(np.argmax(use)), limits.limits[name]
    joints = getattr(system, "joint_names", ())
    where = f" of {joints[worst]}" if len(joints) == len(use) else ""
    source = limits.sources.get(name, "")
    more = use[worst] - 1
    excess = f"{100 * more:.0f} %" if more < 1 else f"a factor of {1 + more:.3g}"
    ends = f"{limit.low[worst]:.3g} … {limit.high[worst]:.3g} {limit.unit}"
    return (
        f"the smallest motion that was tried exceeds the limit of {name}{where}, {ends}"
        f"{f' (from {source})' if source else ''}, by {excess} in simulation",
        f"Widen the limit of {name} in a file for --limits"
        + (", or restrict the positions to where gravity asks for less." if joints else "."),
    )


def _touched(motions: Motions, logs: Sequence[Log]) -> str:
    """The first contact along simulated motions, in words; "" if there is none to look for."""
    if not isinstance(motions, JointMotions) or motions.contacts is None:
        return ""
    system, every = motions.experiment.system, motions.stride
    for log in logs:
        words = motions.contacts.touching(coordinates_of(system, log.q[::every]))
        if any(words):
            return next(filter(None, words))
    return ""


def _simulated(
    experiment: Experiment, driver: DriverConfig, limits: Limits
) -> tuple[tuple[Log, ...], dict[str, Array] | None]:
    """The motions under all draws, and the largest use of every limit; None if one diverges."""
    logs, uses = [], []
    for draw, theta in enumerate(experiment.draws):
        log = experiment.simulate(driver, draw, experiment.scenario.duration)
        if log is None:
            return tuple(logs), None
        logs.append(log)
        extents = extents_of(experiment.system, log, theta)
        if "acceleration" in extents:
            later = log.part(int(np.searchsorted(log.t, _STARTED)), len(log.t))
            extents["acceleration"] = extents_of(experiment.system, later, theta)["acceleration"]
        uses.append(limits.entries(extents))
    return tuple(logs), {name: np.max([own[name] for own in uses], axis=0) for name in uses[0]}
