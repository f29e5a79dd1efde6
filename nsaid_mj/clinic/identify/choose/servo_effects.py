"""Effects beyond a servo's equation, accepted if held-out logs are predicted better with them.

First those of a joint: half of the logs, or of the blocks of one, are predicted from the rest,
once with the five parameters of the equation, and once with an effect as a sixth, each after some
Gauss–Newton steps from the fit. MuJoCo's position servos have none of these effects, so they are
reported, and the exported file keeps plain friction. Backlash is no candidate: its residuals are
below a step of the encoder (docs/servo_arms.md). Second, a controller's limits of the targets.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from ....base import Finding
from ....core import Array, Indices
from ....lab import followed_targets
from ...servos.fit import JointFit, OutputError, minimise, weights
from ...servos.joint_fits import alone
from ...servos.logs import TRAVEL, ServoLog
from ...servos.simulation import NONE
from .columns import HELD
from .options import (
    EFFECT,
    LOADED,
    PROFILE,
    PROMISING,
    SLIDING,
    SMOOTHING,
    TOP_SPEED,
    improves,
)

_COLUMNS = {SLIDING.name: 5, LOADED.name: 6}  # of the derivatives by the effects
_STEPS = 2  # from the fit to all samples
_LONGEST = 1.0  # step of ln θ
_WORDS = {
    "stribeck": (
        "friction decreases with speed: at rest it is higher by {:.2g} {} of servo error",
        1e3,
        "The real joint starts to move later than the exported model.",
    ),
    "load": (
        "friction increases with the load, by {:.2g} of its torque",
        1.0,
        "The exported friction is that of the logs' loads.",
    ),
}


def effects_of(name: str, unit: str, fit: OutputError[JointFit], cluster: Indices) -> list[Finding]:
    """The effects that improve the prediction of both halves.

    They are those of the joint called `name`, a thousandth of whose position is in `unit`; cluster
    (N,) is the log or block of each sample.
    """
    halves = [cluster % 2 == side for side in (0, 1)]
    counted = [fit.of.used * (1 - half) for half in halves]
    if not all(part.any() for part in counted):
        return []

    def errors(effect: str | None) -> tuple[list[float], list[float]]:
        """Errors of both halves, each predicted from the other, and the effect's sizes there."""
        pairs = [_fitted(fit, half, effect) for half in halves]
        return [
            float(np.abs(moved.residual(x)) @ part / part.sum())
            for (x, moved), part in zip(pairs, counted, strict=True)
        ], [getattr(moved.effects, effect) if effect else 0.0 for _, moved in pairs]

    before, _ = errors(None)
    found = []
    for effect, (words, factor, remedy) in _WORDS.items():
        after, sizes = errors(effect)
        middle = float(np.mean(sizes))
        possible = effect != "load" or middle < HELD
        if possible and improves(np.array(before), np.array(after), EFFECT):
            text = (
                f"{words.format(factor * middle, unit)}; with it, the error on held-out halves of "
                f"the logs is {1e3 * np.mean(after):.2g} {unit} instead of "
                f"{1e3 * np.mean(before):.2g}"
            )
            data = {"effect": effect, "size": middle}
            found.append(Finding("note", "beyond_the_equation", name, text, remedy, data))
    return found


def _fitted(fit: OutputError[JointFit], half: Array, effect: str | None) -> tuple[Array, JointFit]:
    """x and the simulation, with an effect, after Gauss–Newton steps on half of the samples."""
    own = fit.of
    prior = fit.prior
    free = prior.free
    columns = free if effect is None else np.append(free, _COLUMNS[effect])
    weight = weights(own, fit.residual, fit.sigma) * half
    precision = np.pad(prior.deviation[free] ** -2.0, (0, len(columns) - len(free)))
    x = fit.x.copy()
    moved = own
    size = 0.0
    for _ in range(_STEPS):
        residual, X = moved.linear(x, columns)
        pull = precision * np.pad((x - prior.mean)[free], (0, len(columns) - len(free)))
        H = (X.T * weight) @ X + np.diag(precision)
        step = -np.linalg.lstsq(H, (X.T * weight) @ residual + pull)[0]
        x[free] += np.clip(step[: len(free)], -_LONGEST, _LONGEST)
        if effect is not None:
            size = max(size + float(step[-1]), 0.0)
            moved = JointFit(own.logs, own.used, NONE._replace(**{effect: size}))
    return x, moved


_LOGS = 4  # that are tried, at most, and of each [s]
_SECONDS = 20.0
_FASTEST = 0.95  # quantile of the moving joints' speeds that is tried first
_SLOW = 0.05  # of a joint that does not move [rad/s or m/s]
_NEAR = 2.5  # factor about the first trial within which the best is sought
_EXACT = 0.01  # relative accuracy of a profile
_PROFILES = (
    (TOP_SPEED.name, "do not move faster than {:.3g} rad/s or m/s"),
    (SMOOTHING.name, "are smoothed over {:.3g} s"),
)


def hidden_profile(logs: Sequence[ServoLog]) -> tuple[Array, tuple[Finding, ...]]:
    """(3,) common profile of all joints' targets, 0 if none, and the findings about it.

    An unmodelled limit or filter of a controller makes servos appear several times more damped than
    they are, with intervals of a few per cent. Halves of a part of the logs, which are without
    loads and profiles, are therefore predicted from each other with and without a profile, which is
    used if it predicts them much better.
    """
    pieces = list(logs) if len(logs) > 1 else logs[0].halves()
    pieces = [
        log.part(slice(None, int(np.searchsorted(log.t, log.t[0] + _SECONDS))))
        for log in pieces[:: -(-len(pieces) // _LOGS)]
    ]
    travel = np.min([np.ptp(log.position, axis=0) for log in pieces], axis=0)
    joints = np.flatnonzero(travel > TRAVEL)
    none = np.zeros(3)
    if len(pieces) < 2 or not len(joints):
        return none, ()
    before = [_errors(pieces, joints, none, side) for side in (0, 1)]

    def ratio(profile: Array, side: int) -> float:
        """Mean over the joints of a half's errors over those without a profile."""
        return float(np.mean(_errors(pieces, joints, profile, side) / before[side]))

    def worse(profile: Array) -> float:
        """The larger ratio; the first one alone if it suffices to reject a profile."""
        first = ratio(profile, 0)
        return max(first, ratio(profile, 1)) if improves(1.0, first, PROMISING) else first

    speeds = np.concatenate([np.abs(np.gradient(x.position, x.t, axis=0)).ravel() for x in pieces])
    fast = float(np.quantile(speeds[speeds > _SLOW], _FASTEST)) if (speeds > _SLOW).any() else 0.0
    tries = [np.array([fast, 0.0, 0.0]), *(np.array([0.0, 0.0, lag]) for lag in SMOOTHING.values)]
    ratios = [worse(profile) for profile in tries]
    best = tries[int(np.argmin(ratios))]
    if not improves(1.0, min(ratios), PROMISING):
        return none, ()
    spread = np.log(_NEAR)
    options = {"xatol": _EXACT}
    least = minimize_scalar(
        lambda x: np.mean([ratio(np.exp(x) * best, side) for side in (0, 1)]),
        bounds=(-spread, spread),
        options=options,
    )
    found = float(np.exp(least.x)) * best
    after = np.array([ratio(found, side) for side in (0, 1)])
    if not improves(np.ones(2), after, PROFILE):
        return none, ()
    name, words = _PROFILES[int(best[0] == 0)]
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
    moved = [log._replace(target=followed_targets(log.t, log.issued, every)) for log in pieces]
    found = np.empty(len(joints))
    for k, j in enumerate(joints):
        other, own = (
            JointFit(logs, np.ones(sum(len(log.t) for log in logs)))
            for logs in ([log.joint(j) for log in moved[half::2]] for half in (1 - side, side))
        )
        fit = minimise(other, *alone(other.logs))
        found[k] = np.abs(own.residual(fit.x)).mean()
    return found
