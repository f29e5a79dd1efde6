"""Structures of systems for compiled loops: sparse inertias and trees of bodies."""

from __future__ import annotations

from typing import NamedTuple

from ..parameters import Array, Indices


class Linkage(NamedTuple):
    """A tree of bodies on 1-DOF joints, the first possibly on a free flyer, for `dynamics.tree`.

    Attributes:
        joints: (b, 40) the joint of every body: R₀, R_c and R_s (9 numbers each), which give the
            body's axes in its parent's as R₀ + R_c cos + R_s sin; position in the parent's frame
            (3) [m]; direction of sliding (3); unit twist [v, ω] (6); speed at which Coulomb
            friction saturates [rad/s or m/s].
        numbers: (b, 3) rows [parent or −1, index of the joint's coordinate in q, kind of joint].
        gravity: (3,) in the world's axes [m/s²].
        columns: (4,) first index in θ of rotor inertias, viscous friction, Coulomb friction and
            motor gains; the first two are equal if there are no rotors. The links begin at 0.
    """

    joints: Array
    numbers: Indices
    gravity: Array
    columns: Indices


class LoadedTree(NamedTuple):
    """A floating-base tree of bodies with general 6×6 inertias, for `dynamics.loaded`.

    Entry (i, j) of a body's inertia, in its own frame, has the number 72 body + 6 i + j if it only
    resists acceleration, as added mass does, and 36 more if it also has weight.

    Attributes:
        linkage: the tree. Its `columns` show where the inertias end in θ.
        places: (e,) numbers of the nonzero entries, as above; an entry contains value · θ_k.
        parameters: (e,) index k of the parameter in each.
        values: (e,) the values of these entries.
    """

    linkage: Linkage
    places: Indices
    parameters: Indices
    values: Array
