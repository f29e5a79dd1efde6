"""The parts of a robot: joints, bodies, inertias, terms of F θ, and where it touches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from .arrays import CIRCLE, FIXED, FREE, HINGE, PLANAR, SLIDE, Array

Actuator = Literal["motor", "servo"]
"""What drives a joint: a torque in proportion to the command, or to a distance from it."""
JointKind = Literal["fixed", "free", "planar", "hinge", "slide", "circle"]
KINDS_OF_JOINT: dict[str, int] = {
    "fixed": FIXED,
    "free": FREE,
    "planar": PLANAR,
    "hinge": HINGE,
    "slide": SLIDE,
    "circle": CIRCLE,
}
"""Names of the kinds of joint; `circle` is a hinge whose position is (cos, sin)."""


@dataclass(frozen=True, eq=False)
class Body:
    """A body and the joint that connects it to its parent."""

    joint: JointKind  # kind of joint
    parent: int = -1  # number of its parent, −1 for the ground; parents come first
    axis: ArrayLike = (0.0, 0.0, 1.0)  # (3,) unit vector of a hinge or slide in the body's axes
    # (3, 3) the body's axes in its parent's where the joint's position is 0
    rotation: ArrayLike = field(default_factory=lambda: np.eye(3))
    position: ArrayLike = (0.0, 0.0, 0.0)  # (3,) position of the joint in the parent's frame [m]
    name: str = ""  # name of the body


@dataclass(frozen=True, eq=False)
class Inertia:
    """A part of a body's 6×6 inertia about its origin, in its axes, linear in θ."""

    body: int  # number of the body
    start: int  # index in θ of the first of its parameters
    # (6, 6, s) with I = tensor · θ[start : start + s]; None for the ten parameters of a rigid body,
    # m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz, which alone have weight
    tensor: Array | None = None

    @classmethod
    def full(
        cls, axes: tuple[int, ...] = (0, 1, 2, 3, 4, 5), body: int = 0, start: int = 0
    ) -> Inertia:
        """Any symmetric matrix on some axes: the upper triangle, row by row."""
        pairs = [(i, j) for at, i in enumerate(axes) for j in axes[at:]]
        entries = [(i, j, k, 1.0) for k, (i, j) in enumerate(pairs)]
        return cls.tied(entries, body, start)

    @classmethod
    def tied(
        cls, entries: list[tuple[int, int, int, float]], body: int = 0, start: int = 0
    ) -> Inertia:
        """A matrix with value · θ_k at (i, j) and (j, i), from rows (i, j, k, value)."""
        tensor = np.zeros((6, 6, 1 + max(k for _, _, k, _ in entries)))
        for i, j, k, value in entries:
            tensor[i, j, k] = tensor[j, i, k] = value
        return cls(body, start, tensor)

    @classmethod
    def cylinder(
        cls, centre: ArrayLike, axis: ArrayLike, length: float, body: int = 0, start: int = 0
    ) -> Inertia:
        """The added inertia of a slender cylinder, θ [kg] spread evenly along its axis.

        It resists motion across the axis only.
        """
        e = np.asarray(axis, dtype=float)
        c = np.asarray(centre, dtype=float)
        across = np.eye(3) - np.outer(e, e)
        to_centre = np.hstack([np.eye(3), np.cross(np.eye(3), c).T])
        inertia = to_centre.T @ across @ to_centre
        inertia[3:, 3:] += length**2 / 12 * across
        return cls(body, start, (0.5 * (inertia + inertia.T))[:, :, None])

    @property
    def whole(self) -> Array:
        """(6, 6, s) the tensor, of a rigid body too."""
        if self.tensor is not None:
            return self.tensor
        tensor = np.zeros((6, 6, 10))
        for i in range(3):
            tensor[i, i, 0] = 1.0
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            # M = [[m, −S(h)], [S(h), I]], with S(h)_ij = −h_k for cyclic i, j, k
            tensor[i, 3 + j, 1 + k] = tensor[3 + j, i, 1 + k] = 1.0
            tensor[j, 3 + i, 1 + k] = tensor[3 + i, j, 1 + k] = -1.0
        for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
            tensor[3 + i, 3 + j, 4 + k] = tensor[3 + j, 3 + i, 4 + k] = 1.0
        return tensor


@dataclass(frozen=True, eq=False)
class Rotor:
    """Inertia that turns or slides with a joint alone: a motor's rotor."""

    dof: int  # number of the velocity
    parameter: int  # index in θ [kg·m² or kg]
    # number of another velocity, if this is the entry of M by which both share a rotor; −1 if the
    # rotor turns with one joint alone
    other: int = -1


@dataclass(frozen=True, eq=False, init=False)
class Column:
    """One term of F θ: a force of known direction and unknown size.

    Several columns may share a parameter.
    """

    kind: str  # name of one of `columns.KINDS`
    parameter: int  # index in θ
    body: int  # number of the body on which it acts, or −1
    dof: int  # number of the velocity, for a force of a joint, or −1
    input: int  # number of the command it reads, or −1
    constants: Mapping[str, ArrayLike]  # the kind's other constants, by name

    def __init__(
        self,
        kind: str,
        parameter: int,
        *,
        body: int = -1,
        dof: int = -1,
        input: int = -1,
        **constants: ArrayLike,
    ):
        for name, value in locals().copy().items():
            if name != "self":
                object.__setattr__(self, name, value)

    @staticmethod
    def polynomial(*coefficients: float) -> Array:
        """The constant `curve` by its coefficients of the command: u, u|u|, u³, u³|u| and so on."""
        return np.array([len(coefficients), *coefficients])

    @staticmethod
    def interpolated(commands: Array, values: Array) -> Array:
        """The constant `curve` through `values` at increasing commands; flat beyond the ends."""
        return np.array([-len(commands), *commands, *values])

    def shifted(self, parameter: int, command: int = 0) -> Column:
        """This term with larger indices of its parameter and of its command, if any."""
        constants = dict[str, Any](self.constants)
        later = self.input + command if self.input >= 0 else self.input
        place = {"body": self.body, "dof": self.dof, "input": later}
        return Column(self.kind, self.parameter + parameter, **place, **constants)


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """Where a body touches its surroundings.

    Attributes:
        body: number of the body.
        centre: (3,) point in the body's frame [m]; the centre of a round foot.
        radius: radius of a round foot, which touches at its lowest point [m]; 0 for a point.
        flat: whether the contact also exerts a torque, as a flat foot's: six rows instead of three.
        normal: (3,) outward normal of the surface in world axes; None for the vertical.
        name: name, for messages.
        sinking: how far along the normal its force may act from this place [m], one standard
            deviation: half of what soft ground and feet yield. With 0 the place is exact.
    """

    body: int
    centre: ArrayLike
    radius: float = 0.0
    flat: bool = False
    normal: ArrayLike | None = None
    name: str = ""
    sinking: float = 0.0

    @property
    def rows(self) -> int:
        """Number of components of its force: 3, or 6 with a torque."""
        return 6 if self.flat else 3


def unit_mass(point: ArrayLike) -> Array:
    """(6, 6) of a mass of 1 kg at a point (3,); its weight is a column `payload`."""
    to_point = np.hstack([np.eye(3), np.cross(np.eye(3), np.asarray(point, dtype=float)).T])
    return to_point.T @ to_point


@dataclass(frozen=True, eq=False)
class Operation:
    """A vehicle's ranges of operation, from which random probes of its structure are drawn.

    Attributes:
        velocity: lowest and highest velocities, two (n,) [m/s, rad/s]; n is 6, 3 in the plane, or 1
            along the vertical.
        command: lowest and highest commands, two (n_u,).
        reach: largest distance from the origin along each axis [m].
        turn: standard deviation of the rotation vector's components [rad]; in the plane, yaw is
            arbitrary.
        state: draws (n,) position coordinates, (n,) velocities and (n_u,) commands, where these
            depend on each other; None if they do not.
    """

    velocity: tuple[Array, Array]
    command: tuple[Array, Array]
    reach: float = 10.0
    turn: float = 1.5
    state: Callable[[np.random.Generator], tuple[Array, Array, Array]] | None = None

    @staticmethod
    def within(
        speed: ArrayLike, most: Array, least: float | None = None, reach: float = 10.0
    ) -> Operation:
        """Up to a speed (n,) in both directions, and commands up to `most` (n_u,).

        The commands begin at `least`, or at −`most`.
        """
        fastest = np.array(speed, dtype=np.float64)
        lowest = -most if least is None else np.full(len(most), least)
        return Operation((-fastest, fastest), (lowest, most), reach)
