"""Gains of the adaptive laws, from the prior's own dynamics along the desired motion.

Shape: the parameters are normalised by their mean effect on the forces, with E over the desired
motion and S = diag(scale),

    Γ = γ S D⁻¹ S,    D = diag(E[S Wᵀ K_d⁻¹ W S]) / largest entry + floor.

Size: while θ̂ − θ is small, s and the adaptation form a loop, M s̈ + K_d ṡ + W (∇²ψ)⁻¹ Wᵀ s ≈ 0. Its
fastest natural frequency ω is what sampling and unmodelled dynamics limit: a delay δ takes ω² δ
from the loop's damping K_d/M. γ gives it a chosen value at the prior, for every law.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...parameters import Array
from ...system import SecondOrderSystem
from .actuation import Actuation
from .reference import Reference

_SAMPLES = 100  # along one period of the desired motion
_PROBES = 20  # configurations over which the prior's inertia is averaged


class Rehearsal(NamedTuple):
    """The prior's W (k, n, p), by its own commands, and M (k, n, n) along the desired motion."""

    W: Array
    M: Array


def rehearse(
    system: SecondOrderSystem,
    prior: Array,
    reference: Reference,
    actuation: Actuation,
    period: float,
) -> Rehearsal:
    """Evaluates the prior's dynamics along a period [s] of the desired motion."""
    W, M = [], []
    for t in np.linspace(0, period, _SAMPLES, endpoint=False).tolist():
        numbers, v = reference.desired(t)
        q = system.position(numbers)
        v_r, a_r = reference(t, q, v)
        idle = system._W(t, q, v, v_r, a_r, np.zeros(system.n_u))
        u = actuation.command(prior, idle @ prior)
        W.append(system._W(t, q, v, v_r, a_r, u))
        M.append(system.mass_matrix(np.concatenate([q, v]), prior))
    return Rehearsal(np.array(W), np.array(M))


def stiffness(rehearsal: Rehearsal, scale: Array, damping: Array, floor: float) -> Array:
    """(p,) the diagonal of Γ⁻¹ at γ = 1 [J], with K_d (n,) and the least entry of D."""
    effect = np.mean((rehearsal.W * scale) ** 2 / damping[:, None], axis=0).sum(axis=0)
    return np.asarray((effect / effect.max() + floor) / scale**2)


def loop_frequency(rehearsal: Rehearsal, mobility: Array) -> float:
    """Largest natural frequency ω [rad/s] of the adaptation's loop along the desired motion.

    `mobility` (p, p) is (∇²ψ)⁻¹ at the prior.
    """
    stiffness = rehearsal.W @ mobility @ rehearsal.W.transpose(0, 2, 1)
    squares = np.linalg.eigvals(np.linalg.solve(rehearsal.M, stiffness)).real
    return float(np.sqrt(squares.max()))


def mean_inertia(system: SecondOrderSystem, prior: Array) -> Array:
    """(n,) diagonal of the prior's mass matrix, averaged over random configurations."""
    rng, total = np.random.default_rng(0), np.zeros(system.n)
    for _ in range(_PROBES):
        q, v, _ = system.random_state(rng)
        total += np.diag(system.mass_matrix(np.concatenate([q, v]), prior))
    return total / _PROBES
