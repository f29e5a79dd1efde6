"""Effects beyond a servo's equation, accepted if held-out logs are predicted better with them.

Half of the logs, or of the blocks of one, are predicted from the other half: once with the five
parameters of the equation, and once with an effect as a sixth, each after some Gauss–Newton steps
from the fit. MuJoCo's position servos have none of these effects, so they are reported, and the
exported file keeps plain friction. Backlash is no candidate: its residuals are below a step of the
encoder (docs/servo_arms.md).
"""

from __future__ import annotations

import numpy as np

from ...parameters import Array, Indices
from ...robot.findings import Finding
from .fit import JointFit, OutputError, Prior, weights
from .simulation import NONE

_WORTH = 0.05  # least relative fall of the mean error of either half
_TRIED = {"stribeck": 1.0, "load": 0.1}  # change of an effect by which it is differentiated:
# of Stribeck friction over the robust residual
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


def effects_of(
    name: str, unit: str, own: JointFit, fit: OutputError, prior: Prior, cluster: Indices
) -> list[Finding]:
    """The effects that improve the prediction of both halves.

    They are those of the joint called `name`, a thousandth of whose position is in `unit`: its
    simulation, fit and prior of five parameters, and cluster (N,), the log or block of each sample.
    """
    halves = [cluster % 2 == side for side in (0, 1)]
    counted = [own.used * (1 - half) for half in halves]
    if not all(part.any() for part in counted):
        return []

    def errors(effect: str | None) -> tuple[list[float], list[float]]:
        """Errors of both halves, each predicted from the other, and the effect's sizes there."""
        pairs = [_fitted(own, fit, prior, half, effect) for half in halves]
        return [
            float(np.abs(moved.residual(x)) @ part / part.sum())
            for (x, moved), part in zip(pairs, counted, strict=True)
        ], [getattr(moved.effects, effect) if effect else 0.0 for _, moved in pairs]

    (before, _), found = errors(None), []
    for effect, (words, factor, remedy) in _WORDS.items():
        after, sizes = errors(effect)
        if all(b < (1 - _WORTH) * a for a, b in zip(before, after, strict=True)):
            middle = float(np.mean(sizes))
            text = (
                f"{words.format(factor * middle, unit)}; with it, the error on held-out halves of "
                f"the logs is {1e3 * np.mean(after):.2g} {unit} instead of "
                f"{1e3 * np.mean(before):.2g}"
            )
            data = {"effect": effect, "size": middle}
            found.append(Finding("note", "beyond_the_equation", name, text, remedy, data))
    return found


def _fitted(
    own: JointFit, fit: OutputError, prior: Prior, half: Array, effect: str | None
) -> tuple[Array, JointFit]:
    """x and the simulation, with an effect, after Gauss–Newton steps on half of the samples."""
    free, weight = prior.free, weights(own, fit.residual, fit.sigma) * half
    P, x, moved = prior.deviation[free] ** -2.0, fit.x.copy(), own
    residual, X = fit.residual, fit.jacobian
    for k in range(_STEPS):
        if k:
            residual, X = moved.residual(x), moved.jacobian(x, free)
        pull, precision = P * (x - prior.mean)[free], P
        size = 0.0
        if effect is not None:
            size = getattr(moved.effects, effect)
            change = _TRIED[effect] * (1.0 if effect == "load" else fit.sigma)
            tried = JointFit(own.logs, own.used, NONE._replace(**{effect: size + change}))
            X = np.column_stack([X, (tried.residual(x) - residual) / change])
            pull, precision = np.append(pull, 0.0), np.append(P, 0.0)
        H = (X.T * weight) @ X + np.diag(precision)
        step = -np.linalg.lstsq(H, (X.T * weight) @ residual + pull)[0]
        x[free] += np.clip(step[: len(free)], -_LONGEST, _LONGEST)
        if effect is not None:
            size = max(size + float(step[-1]), 0.0)
            moved = JointFit(own.logs, own.used, NONE._replace(**{effect: size}))
    return x, moved
