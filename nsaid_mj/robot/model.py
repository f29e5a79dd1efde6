"""A robot as its model file describes it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..parameters import Array
from .findings import Finding


@dataclass(frozen=True)
class RobotModel:
    """A robot as its model file describes it: kinematics, and guesses of its parameters.

    Attributes:
        name: of the robot.
        source: the file; None for a packed robot or vehicle.
        kind: format of the file, or `vehicle`.
        model: Pinocchio's model (`pin.Model`), joints locked; None for a vehicle.
        joints: (n_u,) names of the 1-DOF joints, in order; of the actuators of a vehicle.
        damping: (n_u,) nominal viscous friction [N·m·s/rad or N·s/m]; 0 where the file has none.
        friction: (n_u,) nominal Coulomb friction [N·m or N]; 0 where the file has none.
        rotor: (n_u,) nominal reflected rotor inertia [kg·m² or kg]; 0 where the file has none.
        gain: (n_u,) nominal force per unit of command [N·m or N]; 1 where the file has none.
        limits: (n_u,) largest absolute command; inf where the file has none.
        system: the structure of a vehicle (a `SecondOrderSystem`); None for a tree of joints.
        prior: (p,) θ̂(0) of a vehicle, its published values; None for a tree of joints.
        findings: what was noticed, such as inertias moved inside the cone or meshes not found.
        visuals: data for drawing the robot, as `recording` wants it.
        file: the file that describes a tree of joints, of packed robots too.
        passive: names of the joints that have no actuator in a file that has some.
    """

    name: str
    source: Path | None
    kind: Literal["urdf", "mjcf", "vehicle"]
    model: Any
    joints: tuple[str, ...]
    damping: Array
    friction: Array
    rotor: Array
    gain: Array
    limits: Array
    system: Any = None
    prior: Array | None = None
    findings: tuple[Finding, ...] = ()
    visuals: Any = None
    file: Path | None = None
    passive: tuple[str, ...] = ()

    @property
    def weightless(self) -> bool:
        """Whether the model file has no masses, so that all inertias are guesses."""
        return any(finding.code == "no_masses" for finding in self.findings)
