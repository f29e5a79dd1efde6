"""One stage of a law: â of (29), Wᵀ Δv and M̂'s smallest pivot, without forming W.

With V and W a body's twists under the velocities v and w, A = J a + J̇ w, T = W × V and I its
inertia in the common frame, the body requires the wrench

    f = I (A + ½ T − g) + ½ (V ×* I W + W ×* I V),

and Σ Jᵀ f = M a + C(v) w − weight, with Ṁ − 2C skew: docs/theory.md, section 1. Its part of Wᵀ Δv,
with D = W − V, is Dᵀ I (A + ½ T − g) + Tᵀ I ½ (V + W). Only rigid-body parameters have weight.

A rigid body's f is that of a field of accelerations: its point r has a + B r, where

    a = A − g + ω_W × v,    B = [α]× + [ω_W]× [ω_V]×,

with A = [A, α] without T. With h = ∫ r dm and Σ = ∫ r rᵀ dm, f = [m a + B h, h × a + ∫ r × B r dm],
and the last integral is the vector of B Σ − (B Σ)ᵀ. Dᵀ f is linear in m, h and Σ alike.
"""

from ..numerics.kernels import f8, helper, index, inlined, kernel, matrix, table, vector, void
from ..numerics.linalg import solve_inline
from .arrays import (
    AT_V,
    COUNT,
    DRIFT,
    FALL,
    FIELD,
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
from .compiled import STRUCTURE, WORKSPACE
from .inertia import add_common_power, write_momentum, write_rigid, write_square
from .spatial import add_cross, add_pushed, add_turned, clear, dot

_A = 12  # columns of the scratch; the first twelve are for anything
_X = 18
_T = 24
_H = 30
_D = 36


@helper(void(table, vector, index, vector, vector, index))
def accumulate(bodies, state, at, x, motion, k):
    """Writes Σ S_j x_j (at = 0), or Σ Ṡ_j x_j (at = RATE), of every body into its column k."""
    axes = bodies.shape[0] * FRAME
    for b in range(bodies.shape[0]):
        parent = bodies[b, PARENT]
        own = b * MOTION + k
        first = bodies[b, AT_V]
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


@helper(void(vector, index, index, vector, index))
def _write_field(state, frame, ground, motion, own):
    """Writes a and B of a rigid body."""
    x = state[frame + TWIST + 3]
    y = state[frame + TWIST + 4]
    z = state[frame + TWIST + 5]
    p = motion[own + VELOCITY + 3]
    q = motion[own + VELOCITY + 4]
    r = motion[own + VELOCITY + 5]
    d = own + DRIFT
    at = own + FIELD
    for i in range(3):
        motion[at + i] = motion[d + i] - state[ground + FALL + i]
    add_cross(motion, own + VELOCITY + 3, state, frame + TWIST, 1.0, motion, at)
    motion[at + 3] = -q * y - r * z
    motion[at + 7] = -p * x - r * z
    motion[at + 11] = -p * x - q * y
    motion[at + 4], motion[at + 6] = x * q - motion[d + 5], y * p + motion[d + 5]
    motion[at + 5], motion[at + 9] = x * r + motion[d + 4], z * p - motion[d + 4]
    motion[at + 8], motion[at + 10] = y * r - motion[d + 3], z * q + motion[d + 3]


@helper(void(vector, index, vector, index))
def _write_rigid_wrench(inertia, k, motion, own):
    """Writes f of the ten parameters, in the common frame."""
    at = own + FIELD
    f = own + WRENCH
    m = inertia[k]
    x = inertia[k + 1]
    y = inertia[k + 2]
    z = inertia[k + 3]
    half = 0.5 * (inertia[k + 4] + inertia[k + 6] + inertia[k + 9])
    xx = half - inertia[k + 4]
    xy = -inertia[k + 5]
    yy = half - inertia[k + 6]
    xz = -inertia[k + 7]  # Σ
    yz = -inertia[k + 8]
    zz = half - inertia[k + 9]
    a = motion[at]
    b = motion[at + 1]
    c = motion[at + 2]
    B0 = motion[at + 3]
    B1 = motion[at + 4]
    B2 = motion[at + 5]
    B3 = motion[at + 6]
    B4 = motion[at + 7]
    B5 = motion[at + 8]
    B6 = motion[at + 9]
    B7 = motion[at + 10]
    B8 = motion[at + 11]
    motion[f] = m * a + B0 * x + B1 * y + B2 * z
    motion[f + 1] = m * b + B3 * x + B4 * y + B5 * z
    motion[f + 2] = m * c + B6 * x + B7 * y + B8 * z
    motion[f + 3] = y * c - z * b + (B6 * xy + B7 * yy + B8 * yz) - (B3 * xz + B4 * yz + B5 * zz)
    motion[f + 4] = z * a - x * c + (B0 * xz + B1 * yz + B2 * zz) - (B6 * xx + B7 * xy + B8 * xz)
    motion[f + 5] = x * b - y * a + (B3 * xx + B4 * xy + B5 * xz) - (B0 * xy + B1 * yy + B2 * yz)


@helper(void(vector, index, vector, index, vector, index, vector))
def _add_square_wrench(state, frame, inertia, at, motion, own, x):
    """Adds f of the 6×6 matrix, in the common frame."""
    for i in range(6):
        x[_X + i] = motion[own + DRIFT + i]
    add_turned(motion, own + VELOCITY, state, frame + TWIST, 0.5, x, _X)
    for r in range(6):
        force = 0.0
        own_half = 0.0
        other_half = 0.0
        row = at + 6 * r
        for c in range(6):
            force += inertia[row + c] * x[_X + c]
            own_half += inertia[row + c] * motion[own + VELOCITY + c]
            other_half += inertia[row + c] * state[frame + TWIST + c]
        motion[own + WRENCH + r] += force
        x[r] = 0.5 * own_half
        x[6 + r] = 0.5 * other_half
    add_pushed(state, frame + TWIST, x, 0, 1.0, motion, own + WRENCH)
    add_pushed(motion, own + VELOCITY, x, 6, 1.0, motion, own + WRENCH)


@helper(void(STRUCTURE, vector, index, vector, WORKSPACE))
def _load(structure, state, ground, theta, work):
    """Writes every body's own inertia and wrench under θ."""
    bodies = structure.bodies
    entries = structure.entries
    values = structure.values
    terms = structure.terms
    motion = work.motion
    inertia = work.inertia
    x = work.scratch
    for b in range(bodies.shape[0]):
        frame = b * FRAME
        own = b * MOTION
        at = b * INERTIA
        if bodies[b, TEN] >= 0:
            write_rigid(state, frame, theta, bodies[b, TEN], inertia, at)
            _write_field(state, frame, ground, motion, own)
            _write_rigid_wrench(inertia, at, motion, own)
        else:
            clear(motion, own + WRENCH, 6)
            if bodies[b, RIGID]:
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
    hx = inertia[1]
    hy = inertia[2]
    hz = inertia[3]
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
    axes = bodies.shape[0] * FRAME
    x = work.scratch
    M = work.M
    motion = work.motion
    inertia = work.inertia
    for b in range(bodies.shape[0] - 1, -1, -1):
        own = b * MOTION
        parent = bodies[b, PARENT]
        first = bodies[b, AT_V]
        if bodies[b, KIND] == FREE:
            _write_base(bodies, inertia, M)
            for j in range(6):
                force[j] = motion[own + WRENCH + j]
            continue
        for j in range(first, first + bodies[b, COUNT]):
            axis = axes + j * FRAME
            force[j] = dot(state, axis, motion, own + WRENCH)
            write_momentum(bodies, b, inertia, state, axis, x)
            for i in range(first, j + 1):
                M[j, i] = dot(state, axes + i * FRAME, x, 0)
            ancestor = parent
            while ancestor >= 0:
                start = bodies[ancestor, AT_V]
                base = bodies[ancestor, KIND] == FREE
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
    bodies = structure.bodies
    rotors = structure.rotors
    ground = (bodies.shape[0] + w.shape[0]) * FRAME
    accumulate(bodies, state, 0, w, work.motion, VELOCITY)
    accumulate(bodies, state, RATE, w, work.motion, DRIFT)
    _load(structure, state, ground, theta, work)
    for r in range(rotors.shape[0]):  # joints on different branches have no other entry of M
        work.M[rotors[r, 0], rotors[r, 1]] = 0.0
    _gather(bodies, state, work, force)
    for r in range(rotors.shape[0]):
        work.M[rotors[r, 0], rotors[r, 1]] += theta[rotors[r, 2]]
    for i in range(force.shape[0]):
        force[i] = -force[i]


@kernel(f8(STRUCTURE, vector, vector, vector, vector, WORKSPACE, vector), inner=True)
def accelerate(structure, state, F, w, theta, work, a):
    """Writes â of (29) into a (n,); returns M̂'s smallest pivot, > 0 on success.

    state (s,) is `kinematics.place` at the measured state, F (z,) the entries of F that can differ
    from 0; C multiplies w (n,), theta (p,) is the estimate. Afterwards `work` holds the bodies'
    motions without J a, and M̂'s factor.
    """
    nonzeros = structure.nonzeros
    write_equations(structure, state, w, theta, work, a)
    for z in range(nonzeros.shape[0]):
        a[nonzeros[z, 0]] += F[z] * theta[nonzeros[z, 1]]
    return solve_inline(work.M, work.L, a)  # (29)


_accelerate = inlined(accelerate)


@helper(void(vector, index, vector, index, vector, vector, index))
def _add_rigid_gradient(state, frame, motion, own, x, gradient, at):
    """Adds Dᵀ f of ten parameters, linear in them; the field still lacks J a."""
    k = own + FIELD
    d = own + VELOCITY
    push = own + PUSH
    u = motion[d] - state[frame + TWIST]
    v = motion[d + 1] - state[frame + TWIST + 1]
    w = motion[d + 2] - state[frame + TWIST + 2]
    p = motion[d + 3] - state[frame + TWIST + 3]
    q = motion[d + 4] - state[frame + TWIST + 4]
    r = motion[d + 5] - state[frame + TWIST + 5]
    a = motion[k] + motion[push]
    b = motion[k + 1] + motion[push + 1]
    c = motion[k + 2] + motion[push + 2]
    B0 = motion[k + 3]
    B4 = motion[k + 7]
    B8 = motion[k + 11]
    B1 = motion[k + 4] - motion[push + 5]
    B3 = motion[k + 6] + motion[push + 5]
    B2 = motion[k + 5] + motion[push + 4]
    B6 = motion[k + 9] - motion[push + 4]
    B5 = motion[k + 8] - motion[push + 3]
    B7 = motion[k + 10] + motion[push + 3]
    x[0] = u * a + v * b + w * c
    x[1] = u * B0 + v * B3 + w * B6 + b * r - c * q
    x[2] = u * B1 + v * B4 + w * B7 + c * p - a * r
    x[3] = u * B2 + v * B5 + w * B8 + a * q - b * p
    xx = r * B3 - q * B6  # what multiplies Σ
    yy = p * B7 - r * B1
    zz = q * B2 - p * B5
    x[4] = 0.5 * (yy + zz - xx)
    x[6] = 0.5 * (xx + zz - yy)
    x[9] = 0.5 * (xx + yy - zz)
    x[5] = q * B7 - r * B4 + r * B0 - p * B6
    x[7] = q * B8 - r * B5 + p * B3 - q * B0
    x[8] = r * B2 - p * B8 + p * B4 - q * B1
    add_common_power(state, frame, x, gradient, at)


@helper(void(STRUCTURE, index, vector, index, vector, index, vector, vector))
def _add_square_gradient(structure, b, state, ground, motion, own, x, gradient):
    """Adds Dᵀ I (A + ½ T) + Tᵀ I ½ (V + W) of a 6×6 matrix, linear in θ."""
    bodies = structure.bodies
    entries = structure.entries
    values = structure.values
    terms = structure.terms
    frame = b * FRAME
    for i in range(6):
        x[_D + i] = motion[own + VELOCITY + i] - state[frame + TWIST + i]
        x[_X + i] = motion[own + DRIFT + i]
        x[_H + i] = 0.5 * (motion[own + VELOCITY + i] + state[frame + TWIST + i])
        x[_T + i] = 0.0
    add_turned(motion, own + VELOCITY, state, frame + TWIST, 1.0, x, _T)
    for i in range(6):
        x[_X + i] += 0.5 * x[_T + i]
    for k in range(bodies[b, TERM], bodies[b, TERMS]):
        total = 0.0
        at = ground + FRAME + 36 * k
        for r in range(6):
            force = 0.0
            momentum = 0.0
            for c in range(6):
                force += state[at + 6 * r + c] * x[_X + c]
                momentum += state[at + 6 * r + c] * x[_H + c]
            total += x[_D + r] * force + x[_T + r] * momentum
        gradient[terms[k, OF]] += total
    if bodies[b, TERM] == bodies[b, TERMS]:  # a base: its axes are the common frame's
        for e in range(bodies[b, FIRST], bodies[b, LAST]):
            r = entries[e, 0]
            c = entries[e, 1]
            power = x[_D + r] * x[_X + c] + x[_T + r] * x[_H + c]
            if r != c:
                power += x[_D + c] * x[_X + r] + x[_T + c] * x[_H + r]
            gradient[entries[e, 2]] += values[e] * power


@kernel(
    f8(STRUCTURE, vector, vector, vector, vector, vector, WORKSPACE, vector, vector), inner=True
)
def stage(structure, state, v, F, w, theta, work, a, gradient):
    """Writes â of (29) into a (n,) and Wᵀ Δv into gradient (p,); returns M̂'s smallest pivot.

    v (n,) is the measured velocity; the other arguments are those of `accelerate`.
    """
    pivot = _accelerate(structure, state, F, w, theta, work, a)
    if not pivot > 0.0:
        return pivot
    bodies = structure.bodies
    rotors = structure.rotors
    nonzeros = structure.nonzeros
    motion = work.motion
    ground = (bodies.shape[0] + w.shape[0]) * FRAME
    accumulate(bodies, state, 0, a, motion, PUSH)
    clear(gradient, 0, gradient.shape[0])
    for b in range(bodies.shape[0]):
        own = b * MOTION
        x = work.scratch
        at = bodies[b, TEN]
        for i in range(6):
            motion[own + DRIFT + i] += motion[own + PUSH + i]
        if at >= 0:
            _add_rigid_gradient(state, b * FRAME, motion, own, x, gradient, at)
        if bodies[b, LAST] > bodies[b, FIRST]:
            _add_square_gradient(structure, b, state, ground, motion, own, x, gradient)
    for r in range(rotors.shape[0]):
        i = rotors[r, 0]
        j = rotors[r, 1]
        gradient[rotors[r, 2]] += a[j] * (w[i] - v[i])
        if i != j:
            gradient[rotors[r, 2]] += a[i] * (w[j] - v[j])
    z = 0
    while z < nonzeros.shape[0]:  # a column's sum in a register does not wait for memory
        k = nonzeros[z, 1]
        power = 0.0
        while z < nonzeros.shape[0] and nonzeros[z, 1] == k:
            i = nonzeros[z, 0]
            power += F[z] * (w[i] - v[i])
            z += 1
        gradient[k] -= power
    return pivot


@kernel(void(STRUCTURE, vector, vector, vector, vector, vector, WORKSPACE, vector), inner=True)
def require(structure, state, F, v, a, theta, work, force):
    """Writes the inverse dynamics M a + C v − F θ of a motion into force (n,).

    If F (z,) is that without commands, these are the motors' torques. state (s,) is that of the
    measured state, v and a are (n,), theta (p,).
    """
    bodies = structure.bodies
    rotors = structure.rotors
    nonzeros = structure.nonzeros
    motion = work.motion
    axes = bodies.shape[0] * FRAME
    accumulate(bodies, state, 0, v, motion, VELOCITY)
    accumulate(bodies, state, RATE, v, motion, DRIFT)
    accumulate(bodies, state, 0, a, motion, PUSH)
    for b in range(bodies.shape[0]):
        for i in range(b * MOTION, b * MOTION + 6):
            motion[DRIFT + i] += motion[PUSH + i]
    _load(structure, state, axes + v.shape[0] * FRAME, theta, work)
    for b in range(bodies.shape[0] - 1, -1, -1):
        wrench = b * MOTION + WRENCH
        parent = bodies[b, PARENT]
        first = bodies[b, AT_V]
        for j in range(first, first + bodies[b, COUNT]):
            force[j] = dot(state, axes + j * FRAME, motion, wrench)
        if parent >= 0:
            for i in range(6):
                motion[parent * MOTION + WRENCH + i] += motion[wrench + i]
    for r in range(rotors.shape[0]):
        i = rotors[r, 0]
        j = rotors[r, 1]
        k = rotors[r, 2]
        force[i] += theta[k] * a[j]
        if i != j:
            force[j] += theta[k] * a[i]
    for z in range(nonzeros.shape[0]):
        force[nonzeros[z, 0]] -= F[z] * theta[nonzeros[z, 1]]
