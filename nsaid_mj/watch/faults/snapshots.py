"""Snapshots of the filter, and detection of changes that are too slow for its innovations.

While θ is constant, θ̂ shifts by no more than the decrease of its covariance explains. Snapshots of
(θ̂, P_θθ) are taken at regular intervals and compared with the present estimate; see `evidence`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core import Array, FilterState, SecondOrderSystem
from .evidence import most_evident, posterior, shift_jumps
from .hypotheses import Hypothesis, most_changed, penalty, slow_changes, together

PERIOD = 0.5
"""Time between two snapshots [s]."""
_BACK = 1.0  # how long a fault may go unnoticed [s]
_SPANS = (2, 4, 8, 16, 32)  # ages, in snapshots, of those that are compared with the present
_TOLERANCE = 1e-3  # relative change of a sound robot's parameter
_SURE = 25.0  # log likelihood ratio, averaged, at which a change counts: odds of 1e-11


class Snapshot(NamedTuple):
    """A filter's estimate at a time."""

    t: float  # when it was taken [s]
    theta: Array  # (p,) θ̂
    P: Array  # (p, p) P_θθ
    noise: Array  # (2n,) variance of the sensors' noise


Snapshots = tuple[Snapshot, ...]
"""Snapshots of a filter, the latest last."""


def rewind(snapshots: Snapshots, t: float, kalman: FilterState) -> None:
    """Sets θ̂, P_θθ and noise of a filter back to a while before time t [s].

    A fault may have begun undetected, and a sensor's jump resembles noise.
    """
    if not snapshots:
        kalman.theta[:], kalman.Ptt[:] = kalman.safe[0], kalman.safe_P[0]
        return
    old = [one for one in snapshots if t - one.t >= _BACK]
    _, theta, P, noise = old[-1] if old else snapshots[0]
    kalman.theta[:] = theta
    kalman.Ptt[:] = P
    kalman.noise.variance[:] = noise


def with_snapshot(snapshots: Snapshots, t: float, kalman: FilterState) -> Snapshots:
    """The snapshots with the filter's estimate at time t [s], and without those too old."""
    now = kalman.theta.copy(), kalman.Ptt.copy(), kalman.noise.variance.copy()
    return (*snapshots, Snapshot(t, *now))[-_SPANS[-1] - 1 :]


class SlowChange(NamedTuple):
    """A slow change."""

    hypothesis: Hypothesis  # what changed
    confidence: float  # its probability among the hypotheses
    size: tuple[float, float, float]  # change, with lower and upper end, in the hypothesis's unit
    theta: Array  # (p,) θ̂ with the change taken into account
    P: Array  # (p, p) its P_θθ
    evidence: float  # logarithm of the averaged likelihood ratio against no change


def slow_change(
    snapshots: Snapshots, kalman: FilterState, system: SecondOrderSystem
) -> SlowChange | None:
    """The most evident change since any of the snapshots; None if none is evident.

    ½ Δᵀ V⁻¹ Δ is an upper bound of the evidence of every jump, see `evidence`. The hypotheses are
    compared only if that bound is large enough.
    """
    best: SlowChange | None = None
    scale = system.space.scale
    hypotheses = list[Hypothesis]()
    tolerance = _TOLERANCE * np.maximum(np.abs(kalman.theta / scale), 0.1)
    for span in _SPANS:
        if span > len(snapshots):
            break
        _, theta, P, _ = snapshots[-span]
        shift = (kalman.theta - theta) / scale
        least = max(_SURE, best.evidence if best else 0.0)
        try:
            if most_evident(P, kalman.Ptt, shift, tolerance) <= least:
                continue
            hypotheses = hypotheses or slow_changes(system, kalman.theta)
            jumps = shift_jumps(P, kalman.Ptt, shift, tolerance, [h.D for h in hypotheses])
        except (np.linalg.LinAlgError, ValueError):
            continue  # exact data leave a covariance that rounding made indefinite, or infinite
        each = zip(jumps, hypotheses, strict=True)
        evidence = np.array([jump.evidence - penalty(h) for jump, h in each])
        k = int(np.argmax(evidence))
        if evidence[k] > least:
            hypothesis = hypotheses[k]
            jump = jumps[k]
            new, new_P = with_jump(P, kalman.Ptt, shift, hypothesis.D)
            if not np.linalg.eigvalsh(new_P)[0] > 0.0:
                continue  # P_s is singular to rounding, and so is all that was computed from it
            hypothesis = most_changed(system.space, hypothesis, jump)
            best = SlowChange(
                hypothesis,
                together(posterior(evidence), hypotheses, k),
                jump.interval(hypothesis.size),
                theta + scale * new,
                new_P,
                float(evidence[k]),
            )
    return best


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
