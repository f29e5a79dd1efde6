"""Trees of bodies, each in its own frame, compiled; here what floats and may carry added mass.

Body 0 floats; body i hangs on one joint. With J_i (6, n) the Jacobian of body i's twist in its own
axes, V_i = J_i v and W_i = J_i w, an inertia I_i, constant in the body, gives

    M = Σ J_iᵀ I_i J_i,    C(v) w = Σ J_iᵀ [I_i J̇_i w − ad_{W_i}ᵀ I_i V_i].

Ṁ − 2C is skew: of each body J̇ᵀ I J − Jᵀ I J̇ is, and so is w ↦ ad_wᵀ h (Fossen's form, see
`rigid_body`). I_i need not be a rigid body's: added mass is one, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit

from .. import recursion
from ..kernels import cholesky, solve
from ..parameters import Array, Indices
from ..spatial import unrotate
from ..system import Linkage
from .joints import floats

_UP = np.array([0.0, 0.0, 1.0])


class Tree(NamedTuple):
    """How the b bodies of a tree hang together.

    Attributes:
        parents: (b,) body that each hangs on, −1 for the base and for what hangs on the ground.
        rotations: (b, 3, 3) joint frame to parent's axes, at joint number 0.
        places: (b, 3) of the joint frame in the parent's axes [m].
        axes: (b, 6) unit twist [v, ω] of the joint in its own frame, 0 for the base.
        numbers: (b,) where q holds the joint's number.
        circular: (b,) whether q holds its cosine and sine instead.
    """

    parents: Indices
    rotations: Array
    places: Array
    axes: Array
    numbers: Indices
    circular: np.ndarray


class Entries(NamedTuple):
    """Inertias linear in θ, sparse: entry (i, j) of body b's holds value·θ_k.

    Attributes:
        places: (e, 4) rows [b, i, j, k]; the first parameters are the inertial ones.
        values: (e,).
        owners: (s,) the body of each inertial parameter.
        gravity: (s,) what its weight is times its mass: g, or 0 where it has inertia only [m/s²].
    """

    places: Indices
    values: Array
    owners: Indices
    gravity: Array


def tree_of(model: pin.Model) -> Tree:
    """The tree of a Pinocchio model of 1-DOF joints, whose root may be a free flyer."""
    data, joints = model.createData(), list(model.joints)[1:]
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = np.zeros((len(joints), 6))
    for joint in joints[floats(model) :]:
        jacobian = pin.getJointJacobian(model, data, joint.id, pin.ReferenceFrame.LOCAL)
        axes[joint.id - 1] = jacobian[:, joint.idx_v]
    placements = list(model.jointPlacements)[1:]
    return Tree(
        np.array([parent - 1 for parent in list(model.parents)[1:]]),
        np.array([placement.rotation for placement in placements]),
        np.array([placement.translation for placement in placements]),
        axes,
        np.array([joint.idx_q for joint in joints]),
        np.array([joint.nq == 2 for joint in joints]),
    )


def linkage_of(model: pin.Model, friction_speed: Array, columns: Indices) -> Linkage:
    """The tree of a Pinocchio model for `recursion`.

    Args:
        model: as for `tree_of`.
        friction_speed: (k,) of the joints [rad/s or m/s].
        columns: (4,) as in `Linkage`.
    """
    tree = tree_of(model)
    joints = np.zeros((len(tree.parents), recursion.WIDTH))
    numbers = np.column_stack([tree.parents, tree.numbers, np.zeros_like(tree.parents)])
    first = len(joints) - len(friction_speed)
    numbers[:first, 2] = recursion.BASE
    for b in range(first, len(joints)):
        R, slide, turn = tree.rotations[b], tree.axes[b, :3], tree.axes[b, 3:]
        along = np.outer(turn, turn)
        turns = np.linalg.norm(turn) > 0.5
        held = along if turns else np.eye(3)
        across = np.array([np.cross(turn, e) for e in np.eye(3)]).T
        for start, part in (
            (recursion.FIXED, held), (recursion.COSINE, np.eye(3) - held), (recursion.SINE, across),
        ):  # fmt: skip
            joints[b, start : start + 9] = (R @ part).ravel()
        joints[b, recursion.PLACE : recursion.PLACE + 3] = tree.places[b]
        joints[b, recursion.TRAVEL : recursion.TRAVEL + 3] = R @ slide
        joints[b, recursion.AXIS : recursion.AXIS + 6] = tree.axes[b]
        joints[b, recursion.FRICTION_SPEED] = friction_speed[b - first]
        turning = recursion.CIRCLE if tree.circular[b] else recursion.TURN
        numbers[b, 2] = turning if turns else recursion.SLIDE
    return Linkage(joints, numbers, model.gravity.linear.copy(), columns)


class Carried(NamedTuple):
    """An inertia that a body carries.

    Attributes:
        body: which.
        tensor: (6, 6, s) with I = tensor · (the next s parameters), in the body's axes.
        gravity: g where it has weight, 0 where it only resists acceleration [m/s²].
    """

    body: int
    tensor: Array
    gravity: float


def entries_of(inertias: list[Carried]) -> Entries:
    """Inertias, one after the other in θ."""
    places, values, start = [], [], 0
    for body, tensor, _ in inertias:
        at = np.argwhere(tensor)
        places.append(np.column_stack([np.full(len(at), body), at + np.array([0, 0, start])]))
        values.append(tensor[tuple(at.T)])
        start += tensor.shape[2]
    sizes = [tensor.shape[2] for _, tensor, _ in inertias]
    return Entries(
        np.concatenate(places),
        np.concatenate(values),
        np.repeat([body for body, _, _ in inertias], sizes),
        np.repeat([gravity for _, _, gravity in inertias], sizes),
    )


@njit(cache=True)
def joint_place(rotation, place, axis, cosine, sine):
    """(3, 3), (3,) a body's frame in its parent's axes at a joint number's cosine and sine.

    A slide's number comes in `sine`.
    """
    turn = axis[3:]
    if turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2] < 0.5:
        return rotation, place + np.dot(rotation, axis[:3] * sine)
    x, y, z = turn
    c = 1 - cosine
    R = np.array(
        [
            [cosine + c * x * x, c * x * y - sine * z, c * x * z + sine * y],
            [c * x * y + sine * z, cosine + c * y * y, c * y * z - sine * x],
            [c * x * z - sine * y, c * y * z + sine * x, cosine + c * z * z],
        ]
    )
    return np.dot(rotation, R), place


@njit(cache=True)
def carry(R, p, twists, carried):
    """Twists (6, n) of a parent as a child at place p with axes R sees them: into `carried`."""
    for j in range(twists.shape[1]):
        x = twists[0, j] + twists[4, j] * p[2] - twists[5, j] * p[1]
        y = twists[1, j] + twists[5, j] * p[0] - twists[3, j] * p[2]
        z = twists[2, j] + twists[3, j] * p[1] - twists[4, j] * p[0]
        for i in range(3):
            carried[i, j] = R[0, i] * x + R[1, i] * y + R[2, i] * z
            carried[3 + i, j] = (
                R[0, i] * twists[3, j] + R[1, i] * twists[4, j] + R[2, i] * twists[5, j]
            )


@njit(cache=True)
def kinematics(tree, q, v):
    """(b, 6, n) Jacobians J_i of the bodies' twists, J̇_i, and (b, 3) upwards in their axes."""
    bodies, n = tree.parents.shape[0], v.shape[0]
    J, J_dot = np.zeros((bodies, 6, n)), np.zeros((bodies, 6, n))
    up = np.empty((bodies, 3))
    up[0] = unrotate(q[3:7], _UP)
    for i in range(6):
        J[0, i, i] = 1.0
    for b in range(1, bodies):
        parent, axis, at = tree.parents[b], tree.axes[b], tree.numbers[b]
        if tree.circular[b]:
            cosine, sine = q[at], q[at + 1]
        elif axis[3] * axis[3] + axis[4] * axis[4] + axis[5] * axis[5] < 0.5:
            cosine, sine = 1.0, q[at]
        else:
            cosine, sine = np.cos(q[at]), np.sin(q[at])
        R, p = joint_place(tree.rotations[b], tree.places[b], axis, cosine, sine)
        carry(R, p, J[parent], J[b])
        carry(R, p, J_dot[parent], J_dot[b])
        rate = v[5 + b]
        for j in range(n):  # Ẋ = −q̇ ad_S X
            x, y, z = J[b, 0, j], J[b, 1, j], J[b, 2, j]
            a, e, c = J[b, 3, j], J[b, 4, j], J[b, 5, j]
            sx, sy, sz, ta, te, tc = axis
            J_dot[b, 0, j] -= rate * (te * z - tc * y + sy * c - sz * e)
            J_dot[b, 1, j] -= rate * (tc * x - ta * z + sz * a - sx * c)
            J_dot[b, 2, j] -= rate * (ta * y - te * x + sx * e - sy * a)
            J_dot[b, 3, j] -= rate * (te * c - tc * e)
            J_dot[b, 4, j] -= rate * (tc * a - ta * c)
            J_dot[b, 5, j] -= rate * (ta * e - te * a)
        for i in range(6):
            J[b, i, 5 + b] += axis[i]
        up[b] = np.dot(R.T, up[parent])
    return J, J_dot, up


@njit(cache=True)
def along(J, v):
    """(b, 6) J_i v."""
    bodies, _, n = J.shape
    twists = np.zeros((bodies, 6))
    for b in range(bodies):
        for i in range(6):
            for j in range(n):
                twists[b, i] += J[b, i, j] * v[j]
    return twists


@njit(cache=True)
def add_inertial(W, entries, J, A, V, turning):
    """Adds the columns of Σ J_iᵀ [I_i A_i − ad_{turning_i}ᵀ I_i V_i] to W (n, p)."""
    count, n = entries.owners.shape[0], W.shape[0]
    force, momentum = np.zeros((count, 6)), np.zeros((count, 6))
    for e in range(entries.values.shape[0]):
        b, i, j, k = entries.places[e]
        force[k, i] += entries.values[e] * A[b, j]
        momentum[k, i] += entries.values[e] * V[b, j]
    for k in range(count):
        b, f, h = entries.owners[k], force[k], momentum[k]
        x, y, z, a, e, c = turning[b]
        f[0] -= h[1] * c - h[2] * e  # ad_wᵀ h = [h_v × ω, h_v × v + h_ω × ω]
        f[1] -= h[2] * a - h[0] * c
        f[2] -= h[0] * e - h[1] * a
        f[3] -= h[1] * z - h[2] * y + h[4] * c - h[5] * e
        f[4] -= h[2] * x - h[0] * z + h[5] * a - h[3] * c
        f[5] -= h[0] * y - h[1] * x + h[3] * e - h[4] * a
        for j in range(n):
            for i in range(6):
                W[j, k] += J[b, i, j] * f[i]


@njit(cache=True)
def add_weight(F, entries, J, up):
    """Adds the columns of the bodies' weights Σ J_iᵀ I_i [−g up, 0] to F (n, p)."""
    for e in range(entries.values.shape[0]):
        b, i, j, k = entries.places[e]
        g = entries.gravity[k]
        if g > 0 and j < 3:
            pull = -g * entries.values[e] * up[b, j]
            for m in range(F.shape[0]):
                F[m, k] += J[b, i, m] * pull


@njit(cache=True)
def mass_tensor(entries, rotor, J, p):
    """(n, n, p) with M(q, θ) = tensor · θ; `rotor` is the first rotor inertia, −1 for none."""
    n = J.shape[2]
    tensor = np.zeros((n, n, p))
    for e in range(entries.values.shape[0]):
        b, i, j, k = entries.places[e]
        for row in range(n):
            for column in range(n):
                tensor[row, column, k] += entries.values[e] * J[b, i, row] * J[b, j, column]
    if rotor >= 0:
        for k in range(n - 6):
            tensor[6 + k, 6 + k, rotor + k] += 1.0
    return tensor


@njit(cache=True)
def mass_matrix(entries, rotor, J, theta):
    """(n, n) M(q, θ)."""
    bodies, _, n = J.shape
    inertias = np.zeros((bodies, 6, 6))
    for e in range(entries.values.shape[0]):
        b, i, j, k = entries.places[e]
        inertias[b, i, j] += entries.values[e] * theta[k]
    M = np.zeros((n, n))
    for b in range(bodies):
        M += np.dot(J[b].T, np.dot(inertias[b], J[b]))
    if rotor >= 0:
        for k in range(n - 6):
            M[6 + k, 6 + k] += theta[rotor + k]
    return M


@njit(cache=True)
def evaluate(entries, rotor, J, J_dot, F, v, w, theta):
    """â of (29), W of (10, 31) and M̂'s smallest pivot."""
    n = v.shape[0]
    V, turning, W = along(J, v), along(J, w), -F
    add_inertial(W, entries, J, along(J_dot, w), V, turning)
    L = np.zeros((n, n))
    pivot = cholesky(mass_matrix(entries, rotor, J, theta), L)
    if not pivot > 0.0:
        return np.full(n, np.nan), W, pivot
    a_hat = solve(L, -np.dot(W, theta))
    add_inertial(W, entries, J, along(J, a_hat), 0.0 * V, turning)
    if rotor >= 0:
        for k in range(n - 6):
            W[6 + k, rotor + k] += a_hat[6 + k]
    return a_hat, W, pivot
