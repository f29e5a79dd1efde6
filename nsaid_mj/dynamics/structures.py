"""What compiled loops know of a system's structure: sparse inertias and trees of bodies."""

from __future__ import annotations

from typing import NamedTuple

from ..parameters import Array, Indices


class ConstantInertia(NamedTuple):
    """M(θ) of a body in its own frame, sparse.

    Attributes:
        entries: (e, 3) rows [i, j, k]: M_ij holds θ_k …
        values: (e,) … times this.
    """

    entries: Indices
    values: Array


class Linkage(NamedTuple):
    """A tree of bodies on 1-DOF joints, the first on a free flyer or not, for `dynamics.tree`.

    Attributes:
        joints: (b, 40) of every body's joint: nine numbers each of R₀, R_c and R_s, the body's axes
            in its parent's being R₀ + R_c cos + R_s sin; its place [m], the way it slides, its
            unit twist [v, ω], the speed at which Coulomb friction is developed [rad/s or m/s].
        numbers: (b, 3) rows [parent or −1, where q holds the joint's number, kind of joint].
        gravity: (3,) in the world's axes [m/s²].
        columns: (4,) where rotor inertias, viscous and Coulomb friction and motor gains begin in θ;
            the first two are equal where there are no rotors. The links begin at 0.
    """

    joints: Array
    numbers: Indices
    gravity: Array
    columns: Indices


class LoadedTree(NamedTuple):
    """A tree whose base floats and whose bodies carry inertias of any kind, for `dynamics.loaded`.

    Entry (i, j) of a body's 6×6 inertia, in its own frame, is numbered 72 body + 6 i + j where it
    only resists acceleration, as added mass does, and 36 more where it has weight.

    Attributes:
        linkage: how the bodies hang together. Its `columns` say where the inertias end in θ.
        places: (e,) what number an entry has …
        parameters: (e,) that holds this parameter of θ …
        values: (e,) … times this.
    """

    linkage: Linkage
    places: Indices
    parameters: Indices
    values: Array
