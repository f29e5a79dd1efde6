"""Products of spatial vectors. Arguments are arrays, each followed by where its vector begins.

Rows are never sliced: a view of an array costs two atomic operations in numba.
"""

from ..numerics.kernels import f8, helper, index, vector, void

_PRODUCT = void(vector, index, vector, index, f8, vector, index)
_MAP = void(vector, index, vector, index, vector, index)


@helper(_PRODUCT)
def add_cross(a, i, b, j, factor, c, k):
    """c += factor · a × b, of 3-vectors."""
    c[k] += factor * (a[i + 1] * b[j + 2] - a[i + 2] * b[j + 1])
    c[k + 1] += factor * (a[i + 2] * b[j] - a[i] * b[j + 2])
    c[k + 2] += factor * (a[i] * b[j + 1] - a[i + 1] * b[j])


@helper(_PRODUCT)
def add_turned(x, i, y, j, factor, z, k):
    """z += factor · x × y, of twists: [ω_x × v_y + v_x × ω_y, ω_x × ω_y]."""
    add_cross(x, i + 3, y, j, factor, z, k)
    add_cross(x, i, y, j + 3, factor, z, k)
    add_cross(x, i + 3, y, j + 3, factor, z, k + 3)


@helper(_PRODUCT)
def add_pushed(x, i, f, j, factor, z, k):
    """z += factor · x ×* f, of a twist and a wrench: [ω × f, ω × n + v × f]."""
    add_cross(x, i + 3, f, j, factor, z, k)
    add_cross(x, i + 3, f, j + 3, factor, z, k + 3)
    add_cross(x, i, f, j, factor, z, k + 3)


@helper(f8(vector, index, vector, index))
def dot(x, i, y, j):
    """Scalar product of a twist and a wrench."""
    return (
        x[i] * y[j]
        + x[i + 1] * y[j + 1]
        + x[i + 2] * y[j + 2]
        + x[i + 3] * y[j + 3]
        + x[i + 4] * y[j + 4]
        + x[i + 5] * y[j + 5]
    )


@helper(f8(vector, index, vector, index))
def dot3(x, i, y, j):
    """Scalar product of 3-vectors."""
    return x[i] * y[j] + x[i + 1] * y[j + 1] + x[i + 2] * y[j + 2]


@helper(void(vector, index, index))
def clear(x, k, count):
    """Sets `count` numbers from x[k] on to 0."""
    for i in range(k, k + count):
        x[i] = 0.0


@helper(_MAP)
def rotate(R, r, a, i, b, k):
    """b = R a, with R (9) row by row; b may not overlap a."""
    for s in range(3):
        b[k + s] = R[r + 3 * s] * a[i] + R[r + 3 * s + 1] * a[i + 1] + R[r + 3 * s + 2] * a[i + 2]


@helper(_MAP)
def unrotate(R, r, a, i, b, k):
    """b = Rᵀ a; see `rotate`."""
    for s in range(3):
        b[k + s] = R[r + s] * a[i] + R[r + 3 + s] * a[i + 1] + R[r + 6 + s] * a[i + 2]


@helper(_MAP)
def into_body(state, frame, x, i, y, k):
    """Writes a twist of the common frame in body axes: [Rᵀ (v + ω × p), Rᵀ ω].

    The twist is x[i :], `frame` is where the body's row begins in the state; y is written from k
    on, and its numbers k + 6 to k + 8 are overwritten too.
    """
    for r in range(3):
        y[k + 6 + r] = x[i + r]
    add_cross(x, i + 3, state, frame + 9, 1.0, y, k + 6)
    unrotate(state, frame, y, k + 6, y, k)
    unrotate(state, frame, x, i + 3, y, k + 3)


@helper(_MAP)
def out_of_body(state, frame, f, i, g, k):
    """Writes a wrench f in body axes in the common frame: [R f, R n + p × R f]."""
    rotate(state, frame, f, i, g, k)
    rotate(state, frame, f, i + 3, g, k + 3)
    add_cross(state, frame + 9, g, k, 1.0, g, k + 3)


@helper(void(vector, index, vector, index, index))
def _turn(R, r, a, at, step):
    """Rotates the 3-vector a[at], a[at + step], a[at + 2 step] in place."""
    x = a[at]
    y = a[at + step]
    z = a[at + 2 * step]
    for s in range(3):
        a[at + s * step] = R[r + 3 * s] * x + R[r + 3 * s + 1] * y + R[r + 3 * s + 2] * z


@helper(void(vector, index, vector, index, index))
def _shift(state, frame, a, at, step):
    """Adds p × (the first three) to the last three of six numbers that begin at a[at]."""
    x = a[at]
    y = a[at + step]
    z = a[at + 2 * step]
    px = state[frame + 9]
    py = state[frame + 10]
    pz = state[frame + 11]
    a[at + 3 * step] += py * z - pz * y
    a[at + 4 * step] += pz * x - px * z
    a[at + 5 * step] += px * y - py * x


@helper(void(vector, index, vector, index))
def turn_square(state, frame, a, at):
    """Overwrites a map of twists to wrenches, (6, 6) in body axes, with the common frame's."""
    for half in range(12):  # R on the left of all four blocks, then Rᵀ on the right
        k = at + half if half < 6 else at + 12 + half
        _turn(state, frame, a, k, 6)
    for half in range(12):
        _turn(state, frame, a, at + 3 * half, 1)
    for r in range(6):  # X = [[1, −p×], [0, 1]] on the right, then its transpose on the left
        _shift(state, frame, a, at + 6 * r, 1)
    for c in range(6):
        _shift(state, frame, a, at + c, 6)
