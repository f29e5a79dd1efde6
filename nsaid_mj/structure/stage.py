"""One stage of a law: â of (29), Wᵀ Δv and M̂'s smallest pivot, without forming W.

With V and W a body's twists under the velocities v and w, A = J a + J̇ w, T = W × V and I its
inertia in the common frame, the body requires the wrench

    f = I (A + ½ T − g) + ½ (V ×* I W + W ×* I V),

and Σ Jᵀ f = M a + C(v) w − weight, with Ṁ − 2C skew: docs/theory.md, section 1. Its part of Wᵀ Δv,
with D = W − V, is Dᵀ I (A + ½ T − g) + Tᵀ I ½ (V + W). Only rigid-body parameters have weight.

For rigid bodies, with a = A − [g, 0] + [ω_W × v, ½ ω_W × ω_V] = [a, α],

    f = [m a + α × h + ½ (ω_V × (ω_W × h) + ω_W × (ω_V × h)),
         h × a + Ī α + ½ (ω_V × Ī ω_W + ω_W × Ī ω_V)].
"""

from __future__ import annotations

from ..numerics.linalg import solve_positive
from .arrays import (
    AT_V,
    COUNT,
    DRIFT,
    FALL,
    FIRST,
    FRAME,
    FREE,
    GENERAL,
    INERTIA,
    KIND,
    LAST,
    MOTION,
    OF,
    PARENT,
    PUSH,
    RATE,
    RIGID,
    SQUARE,
    TEN,
    TERM,
    TERMS,
    TWIST,
    VELOCITY,
    WRENCH,
)
from .compiled import (
    STRUCTURE,
    WORKSPACE,
    f8,
    helper,
    i8,
    kernel,
    matrix,
    routine,
    table,
    vector,
    void,
)
from .inertia import (
    add_common_power,
    add_momentum,
    add_square,
    add_turning,
    write_rigid,
    write_square,
)
from .spatial import add_cross, add_pushed, add_turned, clear, dot, dot3

_A, _X, _T, _H, _D = 12, 18, 24, 30, 36  # columns of the scratch; the first twelve are for anything
_OMEGA = 3  # the angular part of a spatial vector


@helper(void(table, vector, i8, vector, vector, i8))
def accumulate(bodies, state, at, x, motion, k):
    """Writes Σ S_j x_j (at = 0), or Σ Ṡ_j x_j (at = RATE), of every body into its column k."""
    axes = bodies.shape[0] * FRAME
    for b in range(bodies.shape[0]):
        parent, own, first = bodies[b, PARENT], b * MOTION + k, bodies[b, AT_V]
        if bodies[b, KIND] == FREE:  # its axes are those of the common frame, which Ṡ = V × S turns
            for i in range(6):
                motion[own + i] = x[i] if at == 0 else 0.0
            if at == RATE:
                add_turned(state, b * FRAME + TWIST, x, 0, 1.0, motion, own)
            continue
        for i in range(6):
            motion[own + i] = motion[parent * MOTION + k + i] if parent >= 0 else 0.0
        for j in range(first, first + bodies[b, COUNT]):
            for i in range(6):
                motion[own + i] += x[j] * state[axes + j * FRAME + at + i]


@helper(void(vector, i8, i8, vector, i8, vector))
def _write_felt(state, frame, ground, motion, own, x):
    """Writes [a, α] of a rigid body."""
    for i in range(3):
        x[_A + i] = motion[own + DRIFT + i] - state[ground + FALL + i]
        x[_A + 3 + i] = motion[own + DRIFT + 3 + i]
    turning = own + VELOCITY + _OMEGA
    add_cross(motion, turning, state, frame + TWIST, 1.0, x, _A)
    add_cross(motion, turning, state, frame + TWIST + _OMEGA, 0.5, x, _A + 3)


@helper(void(vector, i8, i8, vector, i8, vector, i8, vector))
def _add_rigid_wrench(state, frame, ground, inertia, at, motion, own, x):
    """Adds f of the ten parameters, in the common frame."""
    _write_felt(state, frame, ground, motion, own, x)
    f, omega, turning = own + WRENCH, frame + TWIST + _OMEGA, own + VELOCITY + _OMEGA
    for i in range(3):
        motion[f + i] += inertia[at] * x[_A + i]
    add_cross(x, _A + 3, inertia, at + 1, 1.0, motion, f)
    add_cross(inertia, at + 1, x, _A, 1.0, motion, f + 3)
    add_turning(inertia, at, x, _A + 3, 1.0, motion, f + 3)
    clear(x, 0, 12)
    add_cross(motion, turning, inertia, at + 1, 0.5, x, 0)
    add_cross(state, omega, inertia, at + 1, 0.5, x, 3)
    add_turning(inertia, at, motion, turning, 0.5, x, 6)
    add_turning(inertia, at, state, omega, 0.5, x, 9)
    add_cross(state, omega, x, 0, 1.0, motion, f)
    add_cross(motion, turning, x, 3, 1.0, motion, f)
    add_cross(state, omega, x, 6, 1.0, motion, f + 3)
    add_cross(motion, turning, x, 9, 1.0, motion, f + 3)


@helper(void(vector, i8, vector, i8, vector, i8, vector))
def _add_square_wrench(state, frame, inertia, at, motion, own, x):
    """Adds f of the 6×6 matrix, in the common frame."""
    for i in range(6):
        x[_X + i] = motion[own + DRIFT + i]
    add_turned(motion, own + VELOCITY, state, frame + TWIST, 0.5, x, _X)
    add_square(inertia, at, x, _X, 1.0, motion, own + WRENCH)
    clear(x, 0, 12)
    add_square(inertia, at, motion, own + VELOCITY, 0.5, x, 0)
    add_square(inertia, at, state, frame + TWIST, 0.5, x, 6)
    add_pushed(state, frame + TWIST, x, 0, 1.0, motion, own + WRENCH)
    add_pushed(motion, own + VELOCITY, x, 6, 1.0, motion, own + WRENCH)


@routine(void(STRUCTURE, vector, i8, vector, WORKSPACE))
def _load(structure, state, ground, theta, work):
    """Writes every body's own inertia and wrench under θ."""
    bodies, entries, values = structure.bodies, structure.entries, structure.values
    terms, motion, inertia, x = structure.terms, work.motion, work.inertia, work.scratch
    for b in range(bodies.shape[0]):
        frame, own, at = b * FRAME, b * MOTION, b * INERTIA
        clear(motion, own + WRENCH, 6)
        if bodies[b, TEN] >= 0:
            write_rigid(state, frame, theta, bodies[b, TEN], inertia, at)
            _add_rigid_wrench(state, frame, ground, inertia, at, motion, own, x)
        elif bodies[b, RIGID]:
            clear(inertia, at, SQUARE)
        at += SQUARE
        if bodies[b, LAST] > bodies[b, FIRST]:
            write_square(bodies, entries, values, terms, b, state, ground, theta, inertia, at)
            _add_square_wrench(state, frame, inertia, at, motion, own, x)
        elif bodies[b, GENERAL]:
            clear(inertia, at, 36)


@helper(void(table, vector, matrix))
def _write_base(bodies, inertia, M):
    """Writes the lower triangle of a free base's M: the inertia of all bodies."""
    for j in range(6):
        for i in range(j + 1):
            M[j, i] = inertia[SQUARE + 6 * j + i] if bodies[0, GENERAL] else 0.0
    if not bodies[0, RIGID]:
        return
    hx, hy, hz = inertia[1], inertia[2], inertia[3]
    for i in range(3):
        M[i, i] += inertia[0]
        for j in range(i + 1):
            M[3 + i, 3 + j] += inertia[4 + i * (i + 1) // 2 + j]
    M[3, 1] -= hz
    M[3, 2] += hy
    M[4, 0] += hz
    M[4, 2] -= hx
    M[5, 0] -= hy
    M[5, 1] += hx


@helper(void(table, vector, WORKSPACE, vector))
def _gather(bodies, state, work, force):
    """Writes M's lower triangle and Σ Jᵀ f (n,), from the tips inwards."""
    axes, x, M = bodies.shape[0] * FRAME, work.scratch, work.M
    motion, inertia = work.motion, work.inertia
    for b in range(bodies.shape[0] - 1, -1, -1):
        own, parent, first = b * MOTION, bodies[b, PARENT], bodies[b, AT_V]
        if bodies[b, KIND] == FREE:
            _write_base(bodies, inertia, M)
            for j in range(6):
                force[j] = motion[own + WRENCH + j]
            continue
        for j in range(first, first + bodies[b, COUNT]):
            axis = axes + j * FRAME
            force[j] = dot(state, axis, motion, own + WRENCH)
            clear(x, 0, 6)
            add_momentum(bodies, b, inertia, state, axis, 1.0, x, 0)
            for i in range(first, j + 1):
                M[j, i] = dot(state, axes + i * FRAME, x, 0)
            ancestor = parent
            while ancestor >= 0:
                start, base = bodies[ancestor, AT_V], bodies[ancestor, KIND] == FREE
                for i in range(start, start + bodies[ancestor, COUNT]):
                    M[j, i] = x[i] if base else dot(state, axes + i * FRAME, x, 0)
                ancestor = bodies[ancestor, PARENT]
        if parent >= 0:
            for i in range(WRENCH, WRENCH + 6):
                motion[parent * MOTION + i] += motion[own + i]
            if bodies[b, RIGID]:
                for i in range(SQUARE):
                    inertia[parent * INERTIA + i] += inertia[b * INERTIA + i]
            if bodies[b, GENERAL]:
                for i in range(SQUARE, SQUARE + 36):
                    inertia[parent * INERTIA + i] += inertia[b * INERTIA + i]


@helper(void(STRUCTURE, vector, vector, vector, WORKSPACE, vector))
def write_equations(structure, state, w, theta, work, force):
    """Writes M̂'s lower triangle into work.M, and −C w (n,) with the weight of rigid bodies."""
    bodies, rotors = structure.bodies, structure.rotors
    ground = (bodies.shape[0] + w.shape[0]) * FRAME
    accumulate(bodies, state, 0, w, work.motion, VELOCITY)
    accumulate(bodies, state, RATE, w, work.motion, DRIFT)
    _load(structure, state, ground, theta, work)
    _gather(bodies, state, work, force)
    for r in range(rotors.shape[0]):
        work.M[rotors[r, 0], rotors[r, 0]] += theta[rotors[r, 1]]
    for i in range(force.shape[0]):
        force[i] = -force[i]


@kernel(f8(STRUCTURE, vector, vector, vector, vector, WORKSPACE, vector))
def accelerate(structure, state, F, w, theta, work, a):
    """Writes â of (29) into a (n,); returns M̂'s smallest pivot, > 0 if it succeeded.

    Args:
        structure: the robot.
        state: (s,) at the measured state, see `kinematics.place`.
        F: (z,) the entries of F that can differ from 0.
        w: (n,) velocity that C multiplies.
        theta: (p,) estimate.
        work: memory; afterwards it holds the bodies' motions without J a, and M̂'s factor.
        a: (n,) written.
    """
    nonzeros = structure.nonzeros
    write_equations(structure, state, w, theta, work, a)
    for z in range(nonzeros.shape[0]):
        a[nonzeros[z, 0]] += F[z] * theta[nonzeros[z, 1]]
    return solve_positive(work.M, work.L, a)  # (29)


@helper(void(vector, i8, i8, vector, i8, vector, vector, i8))
def _add_rigid_gradient(state, frame, ground, motion, own, x, gradient, at):
    """Adds Dᵀ f of ten parameters, linear in them."""
    omega, turning, alpha = frame + TWIST + _OMEGA, own + VELOCITY + _OMEGA, _A + 3
    _write_felt(state, frame, ground, motion, own, x)
    for i in range(6):
        x[_D + i] = motion[own + VELOCITY + i] - state[frame + TWIST + i]
    along, across = 0.5 * dot3(motion, turning, x, _D), 0.5 * dot3(state, omega, x, _D)
    both = dot3(motion, turning, state, omega)
    x[0] = dot3(x, _D, x, _A)
    for i in range(3):
        x[1 + i] = along * state[omega + i] + across * motion[turning + i] - both * x[_D + i]
    add_cross(x, _D, x, alpha, 1.0, x, 1)
    add_cross(x, _A, x, _D + 3, 1.0, x, 1)
    clear(x, _T, 6)  # ½ δ × ω_V and ½ δ × ω_W
    add_cross(x, _D + 3, state, omega, 0.5, x, _T)
    add_cross(x, _D + 3, motion, turning, 0.5, x, _T + 3)
    for r in range(3):
        d, s, t = x[_D + 3 + r], x[_T + r], x[_T + 3 + r]
        for c in range(r):
            x[4 + r * (r + 1) // 2 + c] = (
                d * x[alpha + c] + s * motion[turning + c] + t * state[omega + c]
                + x[_D + 3 + c] * x[alpha + r] + x[_T + c] * motion[turning + r]
                + x[_T + 3 + c] * state[omega + r]
            )  # fmt: skip
        x[4 + r * (r + 3) // 2] = d * x[alpha + r] + s * motion[turning + r] + t * state[omega + r]
    add_common_power(state, frame, x, gradient, at)


@helper(void(STRUCTURE, i8, vector, i8, vector, i8, vector, vector))
def _add_square_gradient(structure, b, state, ground, motion, own, x, gradient):
    """Adds Dᵀ I (A + ½ T) + Tᵀ I ½ (V + W) of a 6×6 matrix, linear in θ."""
    bodies, entries, values = structure.bodies, structure.entries, structure.values
    terms, frame = structure.terms, b * FRAME
    for i in range(6):
        x[_D + i] = motion[own + VELOCITY + i] - state[frame + TWIST + i]
        x[_X + i] = motion[own + DRIFT + i]
        x[_H + i] = 0.5 * (motion[own + VELOCITY + i] + state[frame + TWIST + i])
        x[_T + i] = 0.0
    add_turned(motion, own + VELOCITY, state, frame + TWIST, 1.0, x, _T)
    for i in range(6):
        x[_X + i] += 0.5 * x[_T + i]
    for k in range(bodies[b, TERM], bodies[b, TERMS]):
        total, at = 0.0, ground + FRAME + 36 * k
        for r in range(6):
            for c in range(6):
                total += state[at + 6 * r + c] * (x[_D + r] * x[_X + c] + x[_T + r] * x[_H + c])
        gradient[terms[k, OF]] += total
    if bodies[b, TERM] == bodies[b, TERMS]:  # a base: its axes are the common frame's
        for e in range(bodies[b, FIRST], bodies[b, LAST]):
            r, c = entries[e, 0], entries[e, 1]
            power = x[_D + r] * x[_X + c] + x[_T + r] * x[_H + c]
            if r != c:
                power += x[_D + c] * x[_X + r] + x[_T + c] * x[_H + r]
            gradient[entries[e, 2]] += values[e] * power


@kernel(f8(STRUCTURE, vector, vector, vector, vector, vector, WORKSPACE, vector, vector))
def stage(structure, state, v, F, w, theta, work, a, gradient):
    """Writes â of (29) into a (n,) and Wᵀ Δv into gradient (p,); returns M̂'s smallest pivot.

    v (n,) is the measured velocity; the other arguments are those of `accelerate`.
    """
    pivot = accelerate(structure, state, F, w, theta, work, a)
    if not pivot > 0.0:
        return pivot
    bodies, rotors, nonzeros = structure.bodies, structure.rotors, structure.nonzeros
    motion, ground = work.motion, (bodies.shape[0] + w.shape[0]) * FRAME
    accumulate(bodies, state, 0, a, motion, PUSH)
    clear(gradient, 0, gradient.shape[0])
    for b in range(bodies.shape[0]):
        own, x, at = b * MOTION, work.scratch, bodies[b, TEN]
        for i in range(6):
            motion[own + DRIFT + i] += motion[own + PUSH + i]
        if at >= 0:
            _add_rigid_gradient(state, b * FRAME, ground, motion, own, x, gradient, at)
        if bodies[b, LAST] > bodies[b, FIRST]:
            _add_square_gradient(structure, b, state, ground, motion, own, x, gradient)
    for r in range(rotors.shape[0]):
        i = rotors[r, 0]
        gradient[rotors[r, 1]] += a[i] * (w[i] - v[i])
    for z in range(nonzeros.shape[0]):
        i = nonzeros[z, 0]
        gradient[nonzeros[z, 1]] -= F[z] * (w[i] - v[i])
    return pivot


@kernel(void(STRUCTURE, vector, vector, vector, vector, vector, WORKSPACE, vector))
def require(structure, state, F, v, a, theta, work, force):
    """Writes what a motion requires beyond F θ, M a + C v − F θ, into force (n,).

    Where F is that without commands, these are the torques of the motors.

    Args:
        structure: the robot.
        state: (s,) at the measured state.
        F: (z,) the entries of F that can differ from 0.
        v: (n,) measured velocity.
        a: (n,) acceleration.
        theta: (p,) parameters.
        work: memory.
        force: (n,) written.
    """
    bodies, rotors, nonzeros = structure.bodies, structure.rotors, structure.nonzeros
    motion, axes = work.motion, bodies.shape[0] * FRAME
    accumulate(bodies, state, 0, v, motion, VELOCITY)
    accumulate(bodies, state, RATE, v, motion, DRIFT)
    accumulate(bodies, state, 0, a, motion, PUSH)
    for b in range(bodies.shape[0]):
        for i in range(b * MOTION, b * MOTION + 6):
            motion[i + DRIFT] += motion[i + PUSH]
    _load(structure, state, axes + v.shape[0] * FRAME, theta, work)
    for b in range(bodies.shape[0] - 1, -1, -1):
        own, parent, first = b * MOTION, bodies[b, PARENT], bodies[b, AT_V]
        for j in range(first, first + bodies[b, COUNT]):
            force[j] = dot(state, axes + j * FRAME, motion, own + WRENCH)
        if parent >= 0:
            for i in range(WRENCH, WRENCH + 6):
                motion[parent * MOTION + i] += motion[own + i]
    for r in range(rotors.shape[0]):
        force[rotors[r, 0]] += theta[rotors[r, 1]] * a[rotors[r, 0]]
    for z in range(nonzeros.shape[0]):
        force[nonzeros[z, 0]] -= F[z] * theta[nonzeros[z, 1]]
