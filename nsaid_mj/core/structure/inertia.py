"""Inertias of bodies, compiled: from θ into the common frame, products with twists, and powers.

Ten rigid-body parameters m, h = m c and Ī (about the frame's origin, in the order m, h, xx, xy, yy,
xz, yz, zz) have formulas of their own. All other inertias are 6×6 matrices.
"""

from ..numerics.kernels import f8, helper, index, matrix, table, vector, void
from .arrays import (
    FIRST,
    FRAME,
    GENERAL,
    INERTIA,
    LAST,
    OF,
    POSITION,
    RIGID,
    SQUARE,
    TEN,
    TERM,
    TERMS,
)
from .spatial import add_cross, clear, dot3, rotate

_PRODUCT = void(vector, index, vector, index, f8, vector, index)

# -- ten parameters --------------------------------------------------------------------------------


@helper(void(vector, index, vector, index, vector, index))
def write_rigid(state, frame, theta, at, inertia, to):
    """Writes the ten parameters θ[at : at + 10] of a body in the common frame."""
    m = theta[at]
    p = frame + POSITION
    xx = theta[at + 4]
    xy = theta[at + 5]
    yy = theta[at + 6]
    xz = theta[at + 7]
    yz = theta[at + 8]
    zz = theta[at + 9]
    rotate(state, frame, theta, at + 1, inertia, to + 1)
    px = state[p]
    py = state[p + 1]
    pz = state[p + 2]
    kx = inertia[to + 1] + 0.5 * m * px
    ky = inertia[to + 2] + 0.5 * m * py
    kz = inertia[to + 3] + 0.5 * m * pz
    for r in range(3):  # R Ī Rᵀ
        a = state[frame + 3 * r]
        b = state[frame + 3 * r + 1]
        c = state[frame + 3 * r + 2]
        x = a * xx + b * xy + c * xz
        y = a * xy + b * yy + c * yz
        z = a * xz + b * yz + c * zz
        for s in range(r + 1):
            R = frame + 3 * s
            inertia[to + 4 + r * (r + 1) // 2 + s] = (
                x * state[R] + y * state[R + 1] + z * state[R + 2]
            )
    both = 2 * (px * kx + py * ky + pz * kz)
    inertia[to] = m
    inertia[to + 1] += m * px
    inertia[to + 2] += m * py
    inertia[to + 3] += m * pz
    inertia[to + 4] += both - 2 * px * kx
    inertia[to + 5] -= px * ky + py * kx
    inertia[to + 6] += both - 2 * py * ky
    inertia[to + 7] -= px * kz + pz * kx
    inertia[to + 8] -= py * kz + pz * ky
    inertia[to + 9] += both - 2 * pz * kz


@helper(_PRODUCT)
def add_turning(inertia, at, x, i, factor, y, k):
    """y += factor · Ī x, of 3-vectors."""
    xx = inertia[at + 4]
    xy = inertia[at + 5]
    yy = inertia[at + 6]
    xz = inertia[at + 7]
    yz = inertia[at + 8]
    zz = inertia[at + 9]
    a = factor * x[i]
    b = factor * x[i + 1]
    c = factor * x[i + 2]
    y[k] += xx * a + xy * b + xz * c
    y[k + 1] += xy * a + yy * b + yz * c
    y[k + 2] += xz * a + yz * b + zz * c


@helper(_PRODUCT)
def add_rigid(inertia, at, x, i, factor, f, k):
    """f += factor · I x of ten parameters: [m v + ω × h, h × v + Ī ω]."""
    for r in range(3):
        f[k + r] += factor * inertia[at] * x[i + r]
    add_cross(x, i + 3, inertia, at + 1, factor, f, k)
    add_cross(inertia, at + 1, x, i, factor, f, k + 3)
    add_turning(inertia, at, x, i + 3, factor, f, k + 3)


# -- 6×6 matrices ----------------------------------------------------------------------------------


@helper(void(table, table, vector, table, index, vector, index, vector, vector, index))
def write_square(bodies, entries, values, terms, b, state, ground, theta, square, at):
    """Writes the 6×6 part of body b's inertia under theta (p,) at square[at], in the common frame.

    `bodies`, `entries`, `values` and `terms` are the robot's; `ground` is where the row of the
    ground begins in the state.
    """
    clear(square, at, 36)
    for k in range(bodies[b, TERM], bodies[b, TERMS]):
        gain = theta[terms[k, OF]]
        start = ground + FRAME + 36 * k
        for i in range(36):
            square[at + i] += gain * state[start + i]
    if bodies[b, TERM] == bodies[b, TERMS]:  # a base: its axes are the common frame's
        for e in range(bodies[b, FIRST], bodies[b, LAST]):
            i = entries[e, 0]
            j = entries[e, 1]
            entry = values[e] * theta[entries[e, 2]]
            square[at + 6 * i + j] += entry
            if i != j:
                square[at + 6 * j + i] += entry


@helper(_PRODUCT)
def add_square(square, at, x, i, factor, f, k):
    """f += factor · I x of the 6×6 matrix at square[at]."""
    for r in range(6):
        total = 0.0
        for c in range(6):
            total += square[at + 6 * r + c] * x[i + c]
        f[k + r] += factor * total


@helper(void(table, index, vector, vector, index, vector))
def write_momentum(bodies, b, inertia, x, i, f):
    """Writes I x into f[:6], with the whole inertia in body b's row of `Workspace.inertia`."""
    k = b * INERTIA
    if bodies[b, RIGID]:
        m = inertia[k]
        hx = inertia[k + 1]
        hy = inertia[k + 2]
        hz = inertia[k + 3]
        u = x[i]
        v = x[i + 1]
        w = x[i + 2]
        p = x[i + 3]
        q = x[i + 4]
        r = x[i + 5]
        f[0] = m * u + q * hz - r * hy
        f[1] = m * v + r * hx - p * hz
        f[2] = m * w + p * hy - q * hx
        f[3] = hy * w - hz * v + inertia[k + 4] * p + inertia[k + 5] * q + inertia[k + 7] * r
        f[4] = hz * u - hx * w + inertia[k + 5] * p + inertia[k + 6] * q + inertia[k + 8] * r
        f[5] = hx * v - hy * u + inertia[k + 7] * p + inertia[k + 8] * q + inertia[k + 9] * r
    else:
        clear(f, 0, 6)
    if bodies[b, GENERAL]:
        add_square(inertia, k + SQUARE, x, i, 1.0, f, 0)


# -- powers: what multiplies θ in xᵀ I y -----------------------------------------------------------


@helper(void(table, table, vector, index, vector, index, index, index, matrix, index))
def add_power(bodies, entries, values, b, x, i, j, heavy, out, row):
    """out[row] (p,) += what multiplies θ in xᵀ I y of body b, twists in its axes.

    In x, i is where the twist x begins, j where y does, and `heavy` where y does for the ten
    parameters, which may have weight. `bodies`, `entries` and `values` are the robot's.
    """
    k = bodies[b, TEN]
    w = i + 3
    if k >= 0:
        out[row, k] += dot3(x, i, x, heavy)
        for r in range(3):
            s = (r + 1) % 3
            t = (r + 2) % 3
            out[row, k + 1 + r] += (
                x[i + s] * x[heavy + 3 + t]
                - x[i + t] * x[heavy + 3 + s]
                + x[heavy + s] * x[w + t]
                - x[heavy + t] * x[w + s]
            )
            for c in range(r):
                both = x[w + r] * x[heavy + 3 + c] + x[w + c] * x[heavy + 3 + r]
                out[row, k + 4 + r * (r + 1) // 2 + c] += both
            out[row, k + 4 + r * (r + 3) // 2] += x[w + r] * x[heavy + 3 + r]
    for e in range(bodies[b, FIRST], bodies[b, LAST]):
        r = entries[e, 0]
        c = entries[e, 1]
        power = x[i + r] * x[j + c]
        if r != c:
            power += x[i + c] * x[j + r]
        out[row, entries[e, 2]] += values[e] * power


@helper(void(vector, index, index, matrix, index, index))
def add_weight(x, i, g, out, row, k):
    """out[row, k : k + 4] += what multiplies m and h in xᵀ I [g, 0] of ten parameters."""
    out[row, k] += dot3(x, i, x, g)
    for r in range(3):
        s = (r + 1) % 3
        t = (r + 2) % 3
        out[row, k + 1 + r] += x[g + s] * x[i + 3 + t] - x[g + t] * x[i + 3 + s]


@helper(void(vector, index, vector, vector, index))
def add_common_power(state, frame, power, out, k):
    """out[k : k + 10] += powers of ten parameters in body axes, from power (10,) in common axes.

    The transpose of the map of `write_rigid`: a body's θ and its powers are dual. `frame` is where
    the body's row begins in the state.
    """
    p = frame + POSITION
    xx = 2 * power[4]  # 2 Z: powers hold off-diagonals twice
    xy = power[5]
    yy = 2 * power[6]
    xz = power[7]
    yz = power[8]
    zz = 2 * power[9]
    px = state[p]
    py = state[p + 1]
    pz = state[p + 2]
    trace = xx + yy + zz
    kx = trace * px - (xx * px + xy * py + xz * pz)
    ky = trace * py - (xy * px + yy * py + yz * pz)
    kz = trace * pz - (xz * px + yz * py + zz * pz)
    hx = power[1] + kx
    hy = power[2] + ky
    hz = power[3] + kz
    out[k] += power[0] + px * (hx - 0.5 * kx) + py * (hy - 0.5 * ky) + pz * (hz - 0.5 * kz)
    for c in range(3):
        a = state[frame + c]
        b = state[frame + 3 + c]
        d = state[frame + 6 + c]
        out[k + 1 + c] += a * hx + b * hy + d * hz
        x = xx * a + xy * b + xz * d
        y = xy * a + yy * b + yz * d
        z = xz * a + yz * b + zz * d
        for s in range(c):
            R = frame + s
            out[k + 4 + c * (c + 1) // 2 + s] += x * state[R] + y * state[R + 3] + z * state[R + 6]
        out[k + 4 + c * (c + 3) // 2] += 0.5 * (x * a + y * b + z * d)
