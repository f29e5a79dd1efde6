"""Snapshots of the filter, and detection of changes that are too slow for its innovations.

Without a change, θ̂ shifts by no more than the decrease of its covariance explains. Snapshots of
(θ̂, P_θθ) are kept at regular intervals, and each is compared with the present; see `evidence`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ....parameters import Array, ParameterSpace
from ..filter import Filter
from .evidence import most_evident, posterior, shift_jumps
from .hypotheses import Hypothesis, most_changed, penalty

PERIOD = 0.5
"""Time between two snapshots [s]."""
_BACK = 1.0  # how long a fault may go unnoticed [s]
_SPANS = (2, 4, 8, 16, 32)  # ages, in snapshots, of those that are compared with the present
_TOLERANCE = 1e-3  # relative change of a sound robot's parameter
_SURE = 25.0  # log likelihood ratio, averaged, at which a change counts: odds of 1e-11


class Watch(NamedTuple):
    """Snapshots of a filter, the latest last."""

    times: tuple[float, ...] = ()  # when they were taken [s]
    thetas: tuple[Array, ...] = ()  # (p,) θ̂ of each
    covariances: tuple[Array, ...] = ()  # (p, p) P_θθ of each
    noises: tuple[Array, ...] = ()  # (2n,) variance of the sensors' noise of each

    def rewind(self, t: float, kalman: Filter) -> None:
        """Sets θ̂, P_θθ and noise back to a while before time t [s].

        A fault may have begun undetected, and a sensor's jump resembles noise.
        """
        if not self.times:
            kalman.theta[:], kalman.Ptt[:] = kalman.safe[0], kalman.safe_P[0]
            return
        old = [i for i, time in enumerate(self.times) if t - time >= _BACK]
        i = old[-1] if old else 0
        kalman.theta[:], kalman.Ptt[:] = self.thetas[i], self.covariances[i]
        kalman.noise.variance[:] = self.noises[i]

    def with_snapshot(self, t: float, kalman: Filter) -> Watch:
        """The watch with the filter's estimate at time t [s], and without snapshots too old."""
        last = -_SPANS[-1]
        return Watch(
            (*self.times, t)[last - 1 :],
            (*self.thetas, kalman.theta.copy())[last - 1 :],
            (*self.covariances, kalman.Ptt.copy())[last - 1 :],
            (*self.noises, kalman.noise.variance.copy())[last - 1 :],
        )


class Found(NamedTuple):
    """A slow change."""

    hypothesis: Hypothesis  # what changed
    confidence: float  # its probability among the hypotheses
    size: tuple[float, float, float]  # change, with lower and upper end, in the hypothesis's unit
    theta: Array  # (p,) θ̂ with the change taken into account
    P: Array  # (p, p) its P_θθ
    evidence: float  # logarithm of the averaged likelihood ratio against no change


def slow_change(
    watch: Watch, kalman: Filter, space: ParameterSpace, what: Callable[[], list[Hypothesis]]
) -> Found | None:
    """The most evident change since any of the snapshots; None if none is evident.

    ½ Δᵀ V⁻¹ Δ bounds the evidence of every jump, see `evidence`, so the hypotheses, of `what`, are
    compared only where that is enough.
    """
    best: Found | None = None
    scale, hypotheses = space.scale, None
    tolerance = _TOLERANCE * np.maximum(np.abs(kalman.theta / scale), 0.1)
    for span in _SPANS:
        if span > len(watch.times):
            break
        theta, P = watch.thetas[-span], watch.covariances[-span]
        shift = (kalman.theta - theta) / scale
        least = max(_SURE, best.evidence if best else 0.0)
        try:
            if most_evident(P, kalman.Ptt, shift, tolerance) <= least:
                continue
            hypotheses = hypotheses or what()
            jumps = shift_jumps(P, kalman.Ptt, shift, tolerance, [h.D for h in hypotheses])
        except (np.linalg.LinAlgError, ValueError):
            continue  # exact data leave a covariance that rounding made indefinite, or infinite
        each = zip(jumps, hypotheses, strict=True)
        evidence = np.array([jump.evidence - penalty(h) for jump, h in each])
        k = int(np.argmax(evidence))
        if evidence[k] > least:
            hypothesis, jump = hypotheses[k], jumps[k]
            new, new_P = with_jump(P, kalman.Ptt, shift, hypothesis.D)
            if not np.linalg.eigvalsh(new_P)[0] > 0.0:
                continue  # P_s is singular to rounding, and so is all that was computed from it
            if hypothesis.kind == "friction" and not jump.evident:
                hypothesis = hypothesis._replace(kind="none")
            elif hypothesis.kind == "friction":
                hypothesis = most_changed(space, hypothesis, jump)
            best = Found(
                hypothesis,
                _together(posterior(evidence), k, hypotheses),
                jump.interval(hypothesis.size),
                theta + scale * new,
                new_P,
                float(evidence[k]),
            )
    return best


def _together(share: Array, k: int, hypotheses: list[Hypothesis]) -> float:
    """Probability of hypothesis k, with that of others of the same kind and part."""
    best = hypotheses[k].kind, hypotheses[k].part
    alike = [(h.kind, h.part) == best for h in hypotheses]
    return float(min(1.0, share[alike].sum()))


def with_jump(Ps: Array, Pt: Array, shift: Array, D: Array) -> tuple[Array, Array]:
    """Shift and covariance that a filter with P_s + D Dᵀ would have reached on the same data.

    With G = P_s⁻¹ D, and P_t that of the filter without a jump: as the information J is the same,
    P = ((P_s + D Dᵀ)⁻¹ + J)⁻¹ = P_t + P_t G (1 + Gᵀ(P_s − P_t) G)⁻¹ Gᵀ P_t, the shift P P_t⁻¹ Δ.
    """
    G = np.linalg.solve(Ps, D)
    carried = Pt @ G
    inner = np.linalg.inv(np.eye(D.shape[1]) + D.T @ G - G.T @ carried)
    P = Pt + carried @ inner @ carried.T
    moved = shift + carried @ inner @ (G.T @ shift)
    return moved, 0.5 * (P + P.T)
