"""The persistent nullspace P_s(θ): its basis, its rank, its directions in words.

All coordinates are θ_s = θ/scale. Rank is decided in one place, `Nullspace.of`, by the singular
values of the row-normalised stack of W·diag(scale) over many samples. Normalising rows does not
change the nullspace, and gives a wrist's torque the same weight as a shoulder's. Eigenvalues of the
Gramian WᵀW would square the condition number, and are not used for rank.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ...base import InvalidInput
from ..parameters import Array, Block, Indices, ParameterSpace, phrase
from ..structure.system import SecondOrderSystem
from .ground import ground_stack

_SMALL = 1e-6  # weights below this share of the leading one are omitted
_STATES = 20  # random ones that show which parameters act on which velocities
_SAME = 1e-7  # 1 − |cosine| below which rows of P̄ count as parallel


@dataclass(frozen=True)
class Nullspace:
    """A split of θ/scale space into P_s(θ) and its orthogonal complement (32–36)."""

    TOLERANCE = 1e-8
    """Singular values below this share of the largest count as 0. For the robots of
    example-robot-data the smallest nonzero one is 3e-7, and the largest that counts as 0 is 6e-11
    (axes meant to be parallel but rotated by a rounded π/2 in the URDF). `gap` gives both for any
    system."""

    P: Array  # (p, r) orthonormal basis of P_s(θ), P̄ (33)
    P_perp: Array  # (p, p−r) orthonormal basis of P_⊥(θ), P̄_⊥ (35)
    singular_values: Array  # (p,) of the stack, largest first, relative to the largest
    tolerance: float  # threshold below which they count as 0

    @classmethod
    def of(cls, stack: Array, tolerance: float = TOLERANCE) -> Nullspace:
        """The nullspace of a stack of regressors, and its complement: the one rank decision.

        The stack (N, p) has rows of W·diag(scale); singular values below `tolerance` of the largest
        count as 0.

        Raises:
            InvalidInput: the stack is empty or not finite.
        """
        if stack.ndim != 2 or not len(stack) or not np.isfinite(stack).all():
            raise InvalidInput(
                "stack", "finite rows (N, p)", f"shape {stack.shape}", "Record longer."
            )
        length = np.linalg.norm(stack, axis=1)
        rows = stack[length > 0] / length[length > 0, None]
        if len(rows) < rows.shape[1]:
            rows = np.vstack([rows, np.zeros((rows.shape[1] - len(rows), rows.shape[1]))])
        R = np.linalg.qr(rows, mode="r")  # same singular values and right vectors, p rows only
        _, s, Vt = scipy.linalg.svd(R, lapack_driver="gesvd")  # gesdd may fail to converge
        s = s / s[0] if s[0] > 0 else s
        rank = int(np.count_nonzero(s > tolerance))
        return cls(Vt[rank:].T, Vt[:rank].T, s, tolerance)

    @classmethod
    def structural(
        cls, system: SecondOrderSystem, theta: Array, rng: np.random.Generator
    ) -> Nullspace:
        """P_s(θ) over all motions, from random states with the acceleration v̇ of (20) under θ.

        M(x, θ) must be positive definite at θ (p,).
        """
        return cls.of(cls.stack(system, theta, rng))

    @staticmethod
    def stack(system: SecondOrderSystem, theta: Array, rng: np.random.Generator) -> Array:
        """(N, p) rows of W(t, x, v, θ)·diag(scale) at random states, N about ten times p.

        Of a robot with contacts they are those of E W, without the forces of any contact.
        """
        count = max(20, 10 * system.p // system.n)
        if contacts := len(system.structure.contacts):
            return ground_stack(system, theta, rng, np.ones((3 * count, contacts), dtype=bool))
        states = [system.random_state(rng) for _ in range(count)]
        q, v, u = (np.array(part) for part in zip(*states, strict=True))
        x = np.hstack([q, v])
        t = rng.uniform(0, 1, count)
        a = system.acceleration(t, x, v, u, theta)
        W = system.regressor(t, x, v, a, u) * system.space.scale
        return W.reshape(-1, system.p)

    @property
    def r(self) -> int:
        """dim P_s(θ)."""
        return self.P.shape[1]

    @property
    def Q(self) -> Array:
        """(p, p) orthogonal change of basis [P̄ P̄_⊥] (36)."""
        return np.hstack([self.P, self.P_perp])

    @property
    def gap(self) -> tuple[float, float]:
        """Smallest singular value above the tolerance and largest below it; 0 if there is none."""
        rank = len(self.singular_values) - self.r
        s = self.singular_values
        return (s[rank - 1] if rank else 0.0, s[rank] if self.r else 0.0)

    def coordinates(self, theta_s: Array) -> tuple[Array, Array]:
        """θ̄_P (..., r) and θ̄_P⊥ (..., p−r) of θ/scale (..., p) (40)."""
        return theta_s @ self.P, theta_s @ self.P_perp

    def ratio(self, theta_s: Array) -> Array:
        """(...,) ‖θ̄_P⊥‖/‖θ_s‖: 0 on the true set, 1 at right angles to it."""
        _, perpendicular = self.coordinates(theta_s)
        length = np.linalg.norm(theta_s, axis=-1)
        return np.linalg.norm(perpendicular, axis=-1) / np.where(length > 0, length, np.inf)

    def directions(self, space: ParameterSpace) -> list[Direction]:
        """Describes P_s(θ) by a sparse basis in words: common scales first, then trade-offs.

        Two parameters whose rows of P̄ are parallel can only change together: they share a scale.
        Every such group that contains actuators is one common scale. Trade-offs of one leading
        parameter against few others describe the subspace of P_s that leaves these groups
        unchanged.
        """
        P = self.P
        found: list[Direction] = []
        groups = _groups(P, space.actuators)
        for group in groups:
            found.append(_scale(group, len(groups) == 1, space))
        held: Indices = np.concatenate(groups) if groups else np.zeros(0, dtype=np.intp)
        rest = P @ _null(P[held]) if len(held) else P
        pivots = _pivots(rest, _preference(space))
        if len(pivots):
            sparse = _sparsen(rest @ np.linalg.inv(rest[pivots]), pivots)
            for column, pivot in enumerate(pivots):
                found.append(_trade(sparse[:, column], pivot, space))
        return found


def parts_of(system: SecondOrderSystem) -> Array:
    """(s, p) 0 or 1: the parameters of each part of a robot whose scale no motion reveals.

    A part is a limb that shares only the fixed base with the others, or the whole robot. Its
    parameters, and no others, act on its velocities: multiplied by one factor they still solve
    W θ = 0. Parameters that act on nothing belong to the first part.
    """
    rng = np.random.default_rng(0)
    q, v, u = zip(*(system.random_state(rng) for _ in range(_STATES)), strict=True)
    a = rng.standard_normal((_STATES, system.n))
    t = rng.uniform(0, 1, _STATES)
    W = system.regressor(t, np.hstack([q, v]), np.array(v), a, np.array(u)) * system.space.scale
    acts = np.abs(W).max(axis=0)
    acts = acts > Nullspace.TOLERANCE * acts.max(axis=1, keepdims=True)
    joined = acts @ acts.T
    for _ in range(system.n):
        joined = joined @ joined
    part = np.argmax(joined, axis=1)[np.argmax(acts, axis=0)]
    return 1.0 * (part == np.unique(part)[:, None])


@dataclass(frozen=True)
class Direction:
    """One direction of P_s(θ), described for a roboticist."""

    words: str  # the change that does not affect the motion, in terms of the parameters' labels
    parameters: tuple[str, ...]  # names of the parameters involved, the leading one first
    weights: tuple[float, ...]  # changes in θ/scale over the leading one's; empty for a scale
    fix: str  # the parameters that one known value would determine


def _groups(P: Array, actuators: Indices) -> list[Indices]:
    """Sets of parameters, each with an actuator, whose rows of P̄ (p, r) are parallel."""
    length = np.linalg.norm(P, axis=1)
    unit = P / np.where(length > 1e-9, length, np.inf)[:, None]
    groups: list[Indices] = []
    for i in actuators:
        if length[i] > 1e-9 and not any(i in group for group in groups):
            cosine = np.abs(unit @ unit[i])
            groups.append(np.flatnonzero(cosine > 1 - _SAME))
    return groups


def _null(rows: Array) -> Array:
    """(r, k) orthonormal basis of the nullspace of rows (m, r)."""
    _, s, Vt = np.linalg.svd(rows)
    return Vt[int(np.count_nonzero(s > 1e-7)) :].T


def _preference(space: ParameterSpace) -> list[int]:
    """Parameters in order of preference as the leading one: masses first, distal links first."""
    block = [k for k, own in enumerate(space.blocks) for _ in own.names]
    return sorted(range(len(space)), key=lambda i: (space.names[i][0] != "m", -block[i], i))


def _pivots(rest: Array, preference: list[int]) -> list[int]:
    """Indices of k parameters whose rows of `rest` (p, k) are independent, preferred ones first."""
    pivots: list[int] = []
    left = rest.copy()
    for threshold in (0.3, 0.03, 1e-4):
        for i in preference:
            if len(pivots) == rest.shape[1]:
                return pivots
            length = np.linalg.norm(left[i])
            if i not in pivots and length > threshold:
                pivots.append(i)
                unit = left[i] / length
                left = left - np.outer(left @ unit, unit)
    return pivots


def _sparsen(basis: Array, pivots: list[int]) -> Array:
    """Combines pairs of columns of a basis (p, k) as long as that reduces `_cost`.

    The weight of a column's pivot stays 1.
    """
    basis = np.where(np.abs(basis) > _SMALL, basis, 0.0)
    improved = True
    while improved:
        improved = False
        for c, pivot in enumerate(pivots):
            for d in range(len(pivots)):
                shared = np.flatnonzero((basis[:, c] != 0) & (basis[:, d] != 0))
                if c == d or not len(shared):
                    continue
                ratios = basis[shared, c] / basis[shared, d]
                same = np.abs(ratios[:, None] - ratios) <= 1e-8 + 1e-5 * np.abs(ratios)
                ratio = ratios[np.argmax(same.sum(axis=0))]  # the most frequent: cancels the most
                candidate = basis[:, c] - ratio * basis[:, d]
                candidate[np.abs(candidate) < _SMALL] = 0.0
                if _cost(candidate) < _cost(basis[:, c]) and abs(candidate[pivot]) > 1e-3:
                    basis[:, c] = candidate / candidate[pivot]
                    improved = True
    return basis


def _cost(column: Array) -> tuple[int, int]:
    """Number of parameters involved, then the sum of their indices: low near the base."""
    involved = np.flatnonzero(column)
    return len(involved), int(involved.sum())


def _scale(group: Indices, whole: bool, space: ParameterSpace) -> Direction:
    """The common scale of a group, named by its actuators, or of all of θ if it is the only one."""
    chosen = set(group.tolist())
    kinds = []
    parts = []
    for block, place in space:
        inside = [i for i in range(place.start, place.stop) if i in chosen]
        kind = "link inertias" if block.geometry == "pseudo_inertia" else _plural(block)
        if whole or inside:
            kinds.append(kind)
        if inside:
            all_inside = len(inside) == len(block) > 1
            parts.append(kind if all_inside else phrase(space.labels[i] for i in inside))
    names = tuple(space.names[i] for i in group)
    driven = (space.labels[i].partition(" of ") for i in space.actuators if i in chosen)
    whose = "everything" if whole else _listed(part or what for what, _, part in driven)
    return Direction(
        f"common scale of {whose}: {_listed(kinds)}",
        names,
        (),
        f"one known number, e.g. {space.labels[group[-1]]}, fixes it, and with it these "
        f"{len(names)}: {', '.join(parts)}",
    )


def _plural(block: Block) -> str:
    uncountable = ("friction", "matrix", "mass", "drag", "buoyancy", "stiffness", "inertia")
    return block.name if len(block) == 1 or block.name.endswith(uncountable) else f"{block.name}s"


def _listed(words: Iterable[str]) -> str:
    *first, last = dict.fromkeys(words)
    return f"{', '.join(first)} and {last}" if first else last


def _trade(weights: Array, pivot: int, space: ParameterSpace) -> Direction:
    others = [i for i in np.argsort(-np.abs(weights)) if i != pivot and abs(weights[i]) > _SMALL]
    lead = space.labels[pivot]
    names = tuple(space.names[i] for i in (pivot, *others))
    if not others:
        words = f"{lead} alone: it does not affect the motion"
        fix = f"only knowing {lead} itself"
    else:
        words = f"{lead} against {phrase(space.labels[i] for i in others)}"
        fix = f"any one of these, e.g. {lead}, determines the others"
    return Direction(words, names, (1.0, *(float(weights[i]) for i in others)), fix)
