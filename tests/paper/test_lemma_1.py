"""Lemma 1, (71–74): what the truth excites vanishes, if commands jump no faster than some rate."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.log import Log
from nsaid_mj.core.nullspace.persistence import PersistenceMonitor
from nsaid_mj.core.parameters import Array, Block, ParameterSpace
from nsaid_mj.core.structure.parts import Body, Column, Inertia
from nsaid_mj.core.structure.structure import Structure
from nsaid_mj.core.structure.system import SecondOrderSystem
from tests.support.bench import accelerations, columns


def test_lemma_1_what_the_truth_excites_vanishes(converged):
    """(74) W(t, x, v, θ) P̄_⊥ θ̄_P⊥ → 0, while W(t, x, v, θ) P̄_⊥ itself stays excited."""
    table, samples, _, theta_hat = converged
    system, nullspace, scale = table.system, table.nullspace, table.system.space.scale
    t, x, v, u = columns(samples)
    a = system.acceleration(t, x, v, u, table.truth)
    W = system.regressor(t, x, v, a, u) * scale @ nullspace.P_perp
    _, across = nullspace.coordinates(theta_hat / scale)
    force = np.abs(np.einsum("kij,kj->ki", W, across)).max(axis=1)
    tenth = len(t) // 10
    assert force[-tenth:].max() < 1e-4 * force[:tenth].max()
    assert np.abs(W[-tenth:]).max() > 0.1 * np.abs(W[:tenth]).max()


def test_71_73_both_terms_of_the_error_rate_vanish(converged):
    """(71–73) Δv̇ → 0 on either side of every jump of the command, and M̂⁻¹ W P̄_⊥ θ̄_P⊥ with it.

    (72) is the sum of the two terms of (64): it is Δv̇, formed without the identifier's v̂̇.
    """
    table, samples, v_hat, theta_hat = converged
    system, nullspace, scale = table.system, table.nullspace, table.system.space.scale
    t, x, v, u = columns(samples)
    _, across = nullspace.coordinates(theta_hat / scale)
    dv, tenth = v_hat - v, len(t) // 10
    M_hat, C_hat = (
        np.array([part(*pair) for pair in zip(x, theta_hat, strict=True)])
        for part in (system.mass_matrix, system.coriolis_matrix)
    )
    before = np.concatenate([u[:1], u[:-1]])  # the command held until t
    assert np.abs(u - before).max() > 0.02  # it does jump
    for command in (before, u):
        a = system.acceleration(t, x, v, command, table.truth)
        a_hat = accelerations(system, t, x, v_hat, command, theta=theta_hat)
        rate = a_hat - table.law.K * dv - a  # (48)
        W = system.regressor(t, x, v, a, command) * scale @ nullspace.P_perp
        excited = np.linalg.solve(M_hat, np.einsum("kij,kj->ki", W, across)[..., None])[..., 0]
        damped = table.law.K * dv + np.linalg.solve(M_hat, C_hat @ dv[..., None])[..., 0]
        assert np.abs(-damped - excited - rate).max() < 1e-9 * np.abs(rate).max()  # (72)
        for vanishing in (rate, excited):  # (71), (73)
            assert np.abs(vanishing[-tenth:]).max() < 1e-4 * np.abs(vanishing[:tenth]).max()


class Cart(SecondOrderSystem):
    """m v̇ = k u: the smallest system with an unknown gain, θ = [m, k], r = 1."""

    def __init__(self):
        mass = Block("mass", ("mass",), ("kg",), np.ones(1))
        gain = Block("gain", ("gain",), ("N",), np.ones(1), actuator=True)
        heavy = Inertia.tied([(i, i, 0, 1.0) for i in range(3)])
        pushed = Column("motor", 1, dof=0, input=0)
        structure = Structure([Body("slide")], [heavy], [pushed], 2, 1)
        super().__init__(structure, ParameterSpace((mass, gain)))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        return rng.uniform(-1, 1, 1), rng.uniform(-1, 1, 1), rng.uniform(-1, 1, 1)


def reversals(jumps: Array, steps: int) -> tuple[Array, Array, Array, Array]:
    """A cart whose command is 1 and −1 in turn, and its identifier: t, |Δv|, |Δv̇| and θ̄_P⊥ (N,).

    Every window of 4 s is well excited in the direction of P_⊥, however fast the command jumps.

    Args:
        jumps: times at which the command changes its sign [s].
        steps: samples between two jumps.
    """
    system, K = Cart(), 2.0  # its true θ is (1, 2)
    pieces = [np.linspace(*pair, steps, endpoint=False) for pair in pairwise(jumps)]
    t, u = np.concatenate(pieces), np.repeat(np.resize([1.0, -1.0], len(pieces)), steps)
    v = np.concatenate([[0.0], np.cumsum(2 * u[:-1] * np.diff(t))])  # exact: v̇ = 2u is constant
    v -= v[-20 * steps :].mean()  # or the cart would run away
    q = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    assert np.abs(q).max() < 1.0  # bounded, as Theorem 1 has it
    P_perp = np.array([[2.0], [-1.0]]) / np.sqrt(5.0)
    W: Array = u[:, None, None] * np.array([2.0, -1.0])  # (10) with the true v̇
    for start in range(0, 36, 4):
        window = W[(t >= start) & (t < start + 4)]
        assert PersistenceMonitor.level_of(window, 4 / len(window), P_perp) > 8.0
    gains, prior = (np.full(1, K), np.full(2, 2.0)), np.array([1.5, 1.5])
    law = paper_identifier(system, *gains, prior, float(np.diff(t).max()))
    log = Log(t, q, v, u)
    state, estimates = law.follow(law.init(log.at(0)), log)
    assert state.status is Status.completed
    dv, (mass, gain) = estimates.v_hat[:, 0] - v, estimates.theta_hat.T
    return t, np.abs(dv), np.abs((gain / mass - 2) * u - K * dv), estimates.theta_hat @ P_perp[:, 0]


def test_lemma_1_holds_for_commands_that_jump_with_a_dwell_time():
    """(71, 74) A command held for 0.5 s at a time: Δv, Δv̇ and θ̄_P⊥ all vanish."""
    t, *vanishing = reversals(np.arange(0, 80.1, 0.5), 10)
    for quantity in vanishing:
        assert np.abs(quantity[t > 72]).max() < 1e-3 * np.abs(quantity[t < 8]).max()


def test_lemma_1_fails_for_commands_that_jump_ever_faster():
    """(71, 74) Jumps at √k/2: Δv → 0 by Theorem 1, but neither Δv̇ nor θ̄_P⊥ does.

    F is bounded, and equally continuous between all its jumps; only a dwell time is missing. The
    excitation is as strong as above, so that Theorem 2 fails with the lemma.
    """
    t, dv, rate, across = reversals(np.sqrt(np.arange(6000)) / 2, 3)
    late = t > 0.9 * t[-1]
    assert dv[late].max() < 0.01 * dv.max()
    assert rate[late].min() > 0.5 * rate.max()
    assert np.abs(across[late]).min() > 0.5 * np.abs(across[0])
