"""The combined regressor W of (10) at one sample, column by column."""

from ..numerics.kernels import cube, f8, helper, index, kernel, matrix, vector, void
from .arrays import (
    AT_V,
    COUNT,
    DRIFT,
    FALL,
    FRAME,
    MOTION,
    PARENT,
    PUSH,
    RATE,
    TWIST,
    VELOCITY,
)
from .compiled import STRUCTURE, WORKSPACE
from .forces import ALL, write_forces
from .forward_dynamics import accumulate
from .inertia import add_power
from .kinematics import place
from .spatial import add_turned, clear, into_body

_V = 0  # vectors in the body's axes
_W = 6
_X = 12
_HEAVY = 18
_S = 24
_P = 30
_R = 36


@helper(void(vector, index, index, vector, index, f8, vector))
def _write_motion(state, frame, ground, motion, own, weight, x):
    """Writes V, W, A + ½ T, and A + ½ T − g, in the body's axes."""
    clear(x, _P, 6)
    add_turned(motion, own + VELOCITY, state, frame + TWIST, 0.5, x, _P)
    for i in range(6):
        x[_P + i] += motion[own + DRIFT + i] + motion[own + PUSH + i]
    into_body(state, frame, state, frame + TWIST, x, _V)
    into_body(state, frame, motion, own + VELOCITY, x, _W)
    into_body(state, frame, x, _P, x, _X)
    for i in range(3):
        x[_P + i] -= weight * state[ground + FALL + i]
    into_body(state, frame, x, _P, x, _HEAVY)


@helper(void(STRUCTURE, index, vector, index, index, vector, matrix))
def _add_row(structure, b, state, axis, j, x, W):
    """Adds a body's columns to row j of W, the row of the velocity with the axis state[axis]."""
    bodies = structure.bodies
    entries = structure.entries
    values = structure.values
    into_body(state, b * FRAME, state, axis, x, _S)
    clear(x, _P, 12)
    add_turned(x, _V, x, _S, -0.5, x, _P)
    add_turned(x, _W, x, _S, -0.5, x, _R)
    add_power(bodies, entries, values, b, x, _S, _X, _HEAVY, W, j)
    add_power(bodies, entries, values, b, x, _P, _W, _W, W, j)
    add_power(bodies, entries, values, b, x, _R, _V, _V, W, j)


@kernel(void(STRUCTURE, vector, vector, vector, f8, vector, WORKSPACE, matrix), inner=True)
def write_regressor(structure, state, w, a, weight, F, work, W):
    """Writes W(t, x, w, a) (n, p): W_M + W_C − F of (10).

    Row j of a body's columns is S_jᵀ f, with f as in `forward_dynamics`; in the body's own axes it
    is Sᵀ I (A + ½ T − g) − ½ (V × S)ᵀ I W − ½ (W × S)ᵀ I V.

    state (s,) is that of the measured state, C multiplies w (n,), a (n,) is the acceleration,
    `weight` is 1 with the weight of rigid bodies and 0 without, F (z,) holds the entries of F.
    """
    bodies = structure.bodies
    rotors = structure.rotors
    nonzeros = structure.nonzeros
    motion = work.motion
    x = work.scratch
    axes = bodies.shape[0] * FRAME
    ground = axes + w.shape[0] * FRAME
    for i in range(W.shape[0]):
        for k in range(W.shape[1]):
            W[i, k] = 0.0
    accumulate(bodies, state, 0, w, motion, VELOCITY)
    accumulate(bodies, state, RATE, w, motion, DRIFT)
    accumulate(bodies, state, 0, a, motion, PUSH)
    for b in range(bodies.shape[0]):
        _write_motion(state, b * FRAME, ground, motion, b * MOTION, weight, x)
        ancestor = b
        while ancestor >= 0:
            first = bodies[ancestor, AT_V]
            for j in range(first, first + bodies[ancestor, COUNT]):
                _add_row(structure, b, state, axes + j * FRAME, j, x, W)
            ancestor = bodies[ancestor, PARENT]
    for r in range(rotors.shape[0]):
        i = rotors[r, 0]
        j = rotors[r, 1]
        k = rotors[r, 2]
        W[i, k] += a[j]
        if i != j:
            W[j, k] += a[i]
    for z in range(nonzeros.shape[0]):
        W[nonzeros[z, 0], nonzeros[z, 1]] -= F[z]


@kernel(
    void(STRUCTURE, matrix, matrix, matrix, matrix, matrix, f8, vector, vector, WORKSPACE, cube)
)
def write_regressors(structure, q, v, u, w, a, weight, state, F, work, W):
    """Writes W(t, x, w, a) (N, n, p) of (10) at N samples.

    q is (N, m), v (N, n) measured, u (N, n_u); C multiplies w (N, n), a (N, n) are accelerations.
    `weight` is 1, or 0 to omit F and the weight of rigid bodies; state (s,) and F (z,) are
    workspace, F zero if the weight is 0.
    """
    for k in range(q.shape[0]):
        place(structure, q[k], v[k], state)
        if weight > 0.0:
            write_forces(structure, state, q[k], v[k], u[k], ALL, work.scratch, F)
        write_regressor(structure, state, w[k], a[k], weight, F, work, W[k])
