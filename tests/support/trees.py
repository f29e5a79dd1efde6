"""Random trees of every kind of joint, with inertias and columns of every kind, for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.columns import KINDS
from nsaid_mj.core.structure.columns.kind import CURVE, LISTED
from nsaid_mj.core.structure.forces import BODY_KINDS
from nsaid_mj.core.structure.parts import Body, Column, Inertia, Rotor
from nsaid_mj.core.structure.structure import Structure

TABLE = Column.interpolated(np.array([-3.0, -0.4, 0.3, 3.0]), np.array([-2.0, -0.7, 0.4, 2.5]))


def unit(rng: np.random.Generator) -> Array:
    """(3,) a random direction."""
    x = rng.standard_normal(3)
    return x / np.linalg.norm(x)


def turn(rng: np.random.Generator) -> Array:
    """(3, 3) a random rotation."""
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return Q * np.linalg.det(Q)


def random_bodies(rng: np.random.Generator, base: str, count: int) -> list[Body]:
    """A tree of `count` bodies; base is `held`, `free` or `planar`."""
    bodies = [] if base == "held" else [Body(base)]  # type: ignore[arg-type]
    while len(bodies) < count:
        kind = str(rng.choice(["hinge", "slide", "circle", "fixed"], p=[0.4, 0.25, 0.25, 0.1]))
        low = -1 if base == "held" else 0
        parent = int(rng.integers(low, len(bodies))) if len(bodies) > max(low, 0) else low
        kind = "hinge" if not bodies else kind
        bodies.append(Body(kind, parent, unit(rng), turn(rng), rng.uniform(-0.5, 0.5, 3)))  # type: ignore[arg-type]
    return bodies


def random_column(
    kind: str, parameter: int, bodies: int, rng: np.random.Generator, **where: int
) -> Column:
    """A column of a kind with random constants."""
    constants: dict[str, Any] = {}
    for name, (size, _) in KINDS[kind].constants.items():
        if size == CURVE:
            constants[name] = TABLE
        elif size == LISTED:
            rows = rng.uniform(0.2, 1.0, (3, 4 if name == "strips" else 5))
            if name == "bodies":
                rows[:, 0] = rng.integers(0, bodies, 3)
            constants[name] = rows
        elif name in ("direction", "axis"):
            constants[name] = unit(rng)
        elif name == "other":  # a velocity before this joint's, or its own
            constants[name] = rng.integers(0, where["dof"] + 1)
        else:
            constants[name] = rng.uniform(0.3, 1.0, size)
    return Column(kind, parameter, **where, **constants)


def random_structure(seed: int, base: str = "held", count: int = 5) -> Structure:
    """A tree with rigid bodies, 6×6 inertias and cylinders, rotors, and columns of all kinds."""
    rng = np.random.default_rng(seed)
    bodies, inertias, columns, rotors, p = random_bodies(rng, base, count), [], [], [], 0
    for b in range(count):
        rigid = rng.random() < 0.7
        if rigid:
            inertias.append(Inertia(b, p))
            p += 10
        if not rigid or rng.random() < 0.4:
            inertias.append(Inertia.full(body=b, start=p))
            p += 21
        if rng.random() < 0.3:
            inertias.append(Inertia.cylinder(rng.uniform(-0.3, 0.3, 3), unit(rng), 0.4, b, p))
            p += 1
    shape = Structure(bodies, inertias, [], p, 0)
    dofs = [
        int(shape.starts[b, 1])
        for b, body in enumerate(bodies)
        if body.joint in ("hinge", "slide", "circle")
    ]
    for dof in dofs[::2]:
        rotors.append(Rotor(dof, p))
        p += 1
    if len(dofs) > 2:
        rotors += [Rotor(dofs[0], p, dofs[2])]
        p += 1
    for name, kind in KINDS.items():
        where: dict[str, int] = {"input": int(rng.integers(0, 3))} if kind.commanded else {}
        if kind.number >= BODY_KINDS:
            where["body"] = int(rng.integers(0, count))
        elif dofs:
            where["dof"] = int(rng.choice(dofs))
        else:
            continue
        columns.append(random_column(name, p, count, rng, **where))
        p += 1
    return Structure(bodies, inertias, columns, p, 3, rotors, rng.uniform(-9, 9, 3))


def physical_theta(structure: Structure, rng: np.random.Generator) -> Array:
    """(p,) parameters under which M is positive definite."""
    theta = rng.uniform(0.5, 1.5, structure.p)
    for rotor in structure.rotors:
        theta[rotor.parameter] *= 0.2 if rotor.other >= 0 else 1.0
    for inertia in structure.inertias:
        at = inertia.start
        if inertia.tensor is None:
            m, c = rng.uniform(1, 2), rng.uniform(-0.2, 0.2, 3)
            A = rng.standard_normal((3, 3))
            own = A @ A.T + 0.5 * np.eye(3) + m * (c @ c * np.eye(3) - np.outer(c, c))
            theta[at : at + 10] = [m, *(m * c), *own[np.tril_indices(3)]]
        elif inertia.tensor.shape[2] == 21:
            A = rng.standard_normal((6, 6))
            theta[at : at + 21] = (A @ A.T + 0.5 * np.eye(6))[np.triu_indices(6)]
    return theta


def random_motion(
    structure: Structure, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array, Array]:
    """(q, v, w, a, u), with w ≠ v."""
    q = []
    for body in structure.bodies:
        if body.joint == "free":
            quaternion = rng.standard_normal(4)
            q += [*rng.standard_normal(3), *(quaternion / np.linalg.norm(quaternion))]
        elif body.joint == "planar":
            q += list(rng.standard_normal(3))
        elif body.joint == "circle":
            angle = rng.uniform(-3, 3)
            q += [np.cos(angle), np.sin(angle)]
        elif body.joint != "fixed":
            q.append(rng.uniform(-2, 2))
    v, w, a = rng.standard_normal((3, structure.n))
    return np.array(q), v, w, a, rng.uniform(-2, 2, structure.n_u)
