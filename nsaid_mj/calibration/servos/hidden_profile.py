"""Detects whether a controller limits the speed of a servo arm's targets, or smooths them.

An unmodelled limit or filter makes servos appear several times more damped than they are, with
intervals of a few per cent. Halves of a part of the logs are therefore predicted from each other
with and without a profile common to all joints, which is used if it predicts them much better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from ...parameters import Array, Indices
from ...robot.findings import Finding
from ...robot.target_profile import followed
from .fit import JointFit, minimise
from .joint_fits import alone
from .logs import TRAVEL, ServoLog

_LOGS, _SECONDS = 4, 20.0  # that are tried, at most, and of each [s]
_SMOOTH = 0.03, 0.08  # lags that are tried first [s]
_FASTEST = 0.95  # quantile of the moving joints' speeds that is tried first
_SLOW = 0.05  # of a joint that does not move [rad/s or m/s]
_WORTH = 0.98  # largest error over that without, of both halves, to look for the best profile
_BETTER = 0.9  # the same, to accept it
_NEAR = 2.5  # factor about the first trial within which the best is sought
_EXACT = 0.01  # relative accuracy of a profile
_WORDS = (
    ("speed", "do not move faster than {:.3g} rad/s or m/s"),
    ("lag", "are smoothed over {:.3g} s"),
)


def hidden_profile(logs: Sequence[ServoLog]) -> tuple[Array, tuple[Finding, ...]]:
    """(3,) common profile of all joints' targets, 0 if none, and the findings about it.

    Args:
        logs: without loads, whose targets have no profile yet.
    """
    pieces = list(logs) if len(logs) > 1 else logs[0].halves()
    pieces = [
        log.part(slice(None, int(np.searchsorted(log.t, log.t[0] + _SECONDS))))
        for log in pieces[:: -(-len(pieces) // _LOGS)]
    ]
    travel = np.min([np.ptp(log.position, axis=0) for log in pieces], axis=0)
    joints, none = np.flatnonzero(travel > TRAVEL), np.zeros(3)
    if len(pieces) < 2 or not len(joints):
        return none, ()
    before = [_errors(pieces, joints, none, side) for side in (0, 1)]

    def ratio(profile: Array, side: int) -> float:
        """Mean over the joints of a half's errors over those without a profile."""
        return float(np.mean(_errors(pieces, joints, profile, side) / before[side]))

    def worse(profile: Array) -> float:
        """The larger ratio; the first one alone if it suffices to reject a profile."""
        first = ratio(profile, 0)
        return first if first >= _WORTH else max(first, ratio(profile, 1))

    speeds = np.concatenate([np.abs(np.gradient(x.position, x.t, axis=0)).ravel() for x in pieces])
    fast = float(np.quantile(speeds[speeds > _SLOW], _FASTEST)) if (speeds > _SLOW).any() else 0.0
    tries = [np.array([fast, 0.0, 0.0]), *(np.array([0.0, 0.0, lag]) for lag in _SMOOTH)]
    ratios = [worse(profile) for profile in tries]
    best = tries[int(np.argmin(ratios))]
    if not min(ratios) < _WORTH:
        return none, ()
    spread, options = np.log(_NEAR), {"xatol": _EXACT}
    least = minimize_scalar(
        lambda x: np.mean([ratio(np.exp(x) * best, side) for side in (0, 1)]),
        bounds=(-spread, spread),
        options=options,
    )
    found = float(np.exp(least.x)) * best
    after = np.array([ratio(found, side) for side in (0, 1)])
    if not after.max() < _BETTER:
        return none, ()
    name, words = _WORDS[int(best[0] == 0)]
    size = float(found.max())
    text = (
        f"the targets that the servos follow {words.format(size)}: with such a profile, the error "
        f"on held-out halves of the logs is {after.mean():.2g} times that without; it was used"
    )
    remedy = f"State your controller's own number in map.toml: `[profile]` `{name} = {size:.3g}`."
    return found, (Finding("warning", "hidden_profile", "", text, remedy, {name: size}),)


def _errors(pieces: Sequence[ServoLog], joints: Indices, profile: Array, side: int) -> Array:
    """(k,) mean absolute errors of k joints in one half of the logs, fitted to the other."""
    every = np.tile(profile, (pieces[0].target.shape[1], 1))
    moved = [log._replace(target=followed(log.t, log.issued, every)) for log in pieces]
    found = np.empty(len(joints))
    for k, j in enumerate(joints):
        other, own = (
            JointFit(logs, np.ones(sum(len(log.t) for log in logs)))
            for logs in ([log.joint(j) for log in moved[half::2]] for half in (1 - side, side))
        )
        first, prior = alone(other.logs)
        fit = minimise(other, first, prior)
        found[k] = np.abs(own.residual(fit.x)).mean()
    return found
