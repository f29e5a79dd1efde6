"""Random trees of joints, written as URDF, with inertias that bodies can have but rarely do.

The generator shares no code with the package: a body is a random distribution of mass, given by its
mass, the place of its centre and its second moments Σ = ∫ x xᵀ dm about it, from which the moment
of inertia tr(Σ) 1 − Σ follows. Any Σ > 0 belongs to some body.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

Vector = np.ndarray


def rotation(rpy: Vector) -> Vector:
    """(3, 3) URDF's rotation Rz(yaw) Ry(pitch) Rx(roll)."""
    (a, b, c), (sa, sb, sc) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1, 0, 0], [0, a, -sa], [0, sa, a]])
    about_y = np.array([[b, 0, sb], [0, 1, 0], [-sb, 0, b]])
    about_z = np.array([[c, -sc, 0], [sc, c, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def second_moments(rng: np.random.Generator, mass: float, size: float) -> Vector:
    """(3, 3) Σ of a body about its centre [kg·m²]: round, long, or very flat, in any axes."""
    lengths = size * 10.0 ** rng.uniform(-0.6, 0.0, 3)
    if rng.random() < 0.3:
        lengths[rng.integers(3)] *= 10.0 ** rng.uniform(-1.3, -0.3)
    turn = rotation(rng.uniform(-np.pi, np.pi, 3))
    return turn @ np.diag(mass * lengths**2 / 12) @ turn.T


def _add_inertial(link: ElementTree.Element, rng: np.random.Generator, mass: float, size: float):
    """Adds an <inertial> whose axes are the link's, or turned, as tools write them."""
    moments = second_moments(rng, mass, size)
    centre = size * rng.uniform(-1, 1, 3) * rng.choice([0.1, 0.4, 0.8])
    rpy = np.zeros(3) if rng.random() < 0.6 else rng.uniform(-np.pi, np.pi, 3)
    turn = rotation(rpy)
    inertia = turn.T @ (np.trace(moments) * np.eye(3) - moments) @ turn
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_text(centre), rpy=_text(rpy))
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    entries = {
        f"i{'xyz'[i]}{'xyz'[j]}": repr(float(inertia[i, j])) for i in range(3) for j in range(i, 3)
    }
    ElementTree.SubElement(inertial, "inertia", entries)


def random_tree(rng: np.random.Generator, joints: int) -> str:
    """The URDF text of a random tree of revolute, continuous and prismatic joints.

    Bodies become lighter and smaller along a branch, down to wrists of some tens of grams.
    """
    root = ElementTree.Element("robot", name="random_tree")
    ElementTree.SubElement(root, "link", name="base")
    depth, mass = {0: 0}, {0: 10.0 ** rng.uniform(0.0, 1.5)}
    for k in range(1, joints + 1):
        parent = k - 1 if k == 1 or rng.random() < 0.8 else int(rng.integers(1, k))
        depth[k] = depth[parent] + 1
        mass[k] = max(0.03, mass[parent] * float(rng.uniform(0.3, 1.1)))
        size = float(rng.uniform(0.4, 1.0) * min(0.5, 0.3 * mass[k] ** 0.33))
        link = ElementTree.SubElement(root, "link", name=f"body_{k}")
        _add_inertial(link, rng, mass[k], size)
        _add_joint(root, rng, k, parent, size)
    return ElementTree.tostring(root, encoding="unicode")


def _add_joint(root: ElementTree.Element, rng: np.random.Generator, k: int, parent: int, size):
    kind = str(rng.choice(["revolute", "continuous", "prismatic"], p=[0.65, 0.15, 0.2]))
    joint = ElementTree.SubElement(root, "joint", name=f"joint_{k}", type=kind)
    ElementTree.SubElement(joint, "parent", link=f"body_{parent}" if parent else "base")
    ElementTree.SubElement(joint, "child", link=f"body_{k}")
    right = rng.integers(-1, 3, 3) * np.pi / 2
    rpy = right if rng.random() < 0.6 else rng.uniform(-np.pi, np.pi, 3)
    place = size * rng.uniform(-1.5, 1.5, 3)
    ElementTree.SubElement(joint, "origin", xyz=_text(place), rpy=_text(rpy))
    axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.7 else rng.standard_normal(3)
    ElementTree.SubElement(joint, "axis", xyz=_text(axis / np.linalg.norm(axis)))
    reach = float(rng.uniform(0.1, 0.4) if kind == "prismatic" else rng.uniform(1.0, 3.0))
    middle = float(rng.uniform(-0.3, 0.3) * reach)
    speed = float(rng.uniform(0.3, 1.0) if kind == "prismatic" else rng.uniform(1.0, 3.0))
    limits = {"effort": "1000", "velocity": repr(speed)}
    if kind != "continuous":
        limits |= {"lower": repr(middle - reach), "upper": repr(middle + reach)}
    ElementTree.SubElement(joint, "limit", limits)


def with_wrong_masses(urdf: str, rng: np.random.Generator, error: float) -> str:
    """The URDF with every link's mass and inertia wrong by one factor of up to 1 ± error."""
    root = ElementTree.fromstring(urdf)
    for inertial in root.iter("inertial"):
        factor = 1 + error * float(rng.uniform(-1, 1))
        for part in ("mass", "inertia"):
            element = inertial.find(part)
            if element is not None:
                for name, value in element.attrib.items():
                    element.set(name, repr(factor * float(value)))
    return ElementTree.tostring(root, encoding="unicode")


def _text(numbers: Vector) -> str:
    return " ".join(repr(float(x)) for x in numbers)
