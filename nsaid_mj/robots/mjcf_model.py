"""A user's MJCF: compiled, with its servos, and as text to edit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from lxml.etree import SubElement
from lxml.etree import _Element as Node

from ..core import Array
from .mjcf_file import actuators_of_file, compile_file, joints_of_file, own_file, relocate
from .tree import (
    TARGET_DELAY,
    TARGET_PROFILE,
    actuators_of,
    joint_names,
    position_servos,
    target_delays,
    target_profiles,
)
from .xml import numbers, write_xml


class MjcfFile:
    """A user's MJCF, compiled.

    Args:
        path: an MJCF or .mjb file.

    Attributes:
        path: as given.
        spec: MuJoCo's specification; None for .mjb.
        model: MuJoCo's compiled model.
        joints: names of all joints; an unnamed one has its body's name.

    Raises:
        BadRobot: MuJoCo rejects the file, or accepts a number that no robot has.
    """

    def __init__(self, path: Path):
        self.path = path
        self.spec, self.model, _ = compile_file(path)
        self.joints = joint_names(self.model)

    def servos_on(self, joints: Iterable[str]) -> list[int]:
        """The numbers of the actuators of joints: of each the first that acts on it alone."""
        return [actuators_of(self.model, self.joints.index(joint))[0] for joint in joints]

    def drives(self, joints: Sequence[str]) -> bool:
        """Whether each of these joints has a position servo, and no other actuator."""
        return position_servos(self.model, self.joints, joints) is not None

    @property
    def delays(self) -> Array:
        """(nu,) delays of the actuators' targets [s]; raises `InvalidInput`, see `tree`."""
        return target_delays(self.model)

    @property
    def profiles(self) -> Array:
        """(nu, 3) profiles of the actuators' targets; raises `InvalidInput`, see `tree`."""
        return target_profiles(self.model)

    def text(self) -> MjcfText:
        """The file's content, for editing."""
        return MjcfText(self)


class MjcfText:
    """The content of an MJCF for editing, with included files in their places.

    Attributes:
        root: the document.
        joints: the elements of the joints by name.
        actuators: the elements of the actuators, in MuJoCo's order.
    """

    def __init__(self, file: MjcfFile):
        self._file = file
        self.root, _ = own_file(file.path, file.spec, file.model, [])
        self.joints = {joint.get("name"): joint for joint in joints_of_file(self.root)}
        self.actuators = actuators_of_file(self.root)

    @staticmethod
    def set(element: Node, **values: float | Iterable[float]) -> None:
        """Gives an element attributes that are numbers, with all their digits."""
        for name, value in values.items():
            element.set(name, numbers(value))

    def state_targets(self, delays: Array, profiles: Array) -> None:
        """States delays (nu,) and profiles (nu, 3) of the targets, where they are not all 0."""
        self._state(TARGET_DELAY, delays)
        self._state(TARGET_PROFILE, profiles.T.ravel())

    def _state(self, name: str, data: Array) -> None:
        """States a custom numeric, if not all its numbers are 0."""
        for custom in self.root.findall("custom"):
            for old in custom.findall(f"numeric[@name='{name}']"):
                custom.remove(old)
        if np.any(data):
            own = SubElement(SubElement(self.root, "custom"), "numeric", name=name)
            self.set(own, data=data)

    def write(self, path: Path, remarks: str, mass: float | None = None) -> None:
        """Writes the document, with remarks at its top.

        Paths of meshes become relative to it. MuJoCo scales all masses to a total `mass` [kg].
        """
        relocate(self.root, self._file.spec, self._file.path, path.resolve().parent)
        if mass is not None:
            self.set(self.root.findall("compiler")[-1], settotalmass=mass)
        write_xml(path, self.root, remarks)
