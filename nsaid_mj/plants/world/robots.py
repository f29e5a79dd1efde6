"""Robot descriptions: a name of example-robot-data or a URDF file, checked before use."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import coal
import numpy as np
import pinocchio as pin
from pinocchio import robot_wrapper

from ...errors import BadRobot, UnknownName
from ...systems.joints import floats

Base = Literal["held", "free"]
"""Whether a floating base is held still on a stand, or left to float."""


@dataclass(frozen=True)
class Robot:
    """A robot as its description has it.

    Attributes:
        name: its name or file.
        base: what has become of a floating base.
        model: Pinocchio's model.
        held: the joint by which a floating-base robot is held on a stand, "" where there is none.
    """

    name: str
    base: Base
    model: pin.Model
    held: str = ""

    @cached_property
    def visual(self) -> Any:
        """Pinocchio's visual geometry, read when first asked for: a UR5's meshes take 0.3 s."""
        return _described(self.name, self.base, meshes=True)[1]


def known_robots() -> list[str]:
    """All names `load_robot` knows."""
    from example_robot_data.robots_loader import ROBOTS

    return sorted(ROBOTS)


def load_robot(name: str, base: Base = "held") -> Robot:
    """Loads a robot of revolute, prismatic and continuous joints.

    Args:
        name: a name of example-robot-data, or the path of a URDF file.
        base: what becomes of a floating base. A URDF file's root is one if it is to be free.

    Raises:
        UnknownName: no such robot, with near matches.
        BadRobot: it cannot be loaded, has a joint of another kind, a link without a possible
            inertia, or no base that could be free.
    """
    model, _, held = _described(name, base, meshes=False)
    check_joints(name, model)
    check_inertias(name, model)
    return Robot(name, base, model, held)


def _described(name: str, base: Base, meshes: bool) -> tuple[pin.Model, Any, str]:
    """The model, its visual geometry, empty without meshes, and the joint that is held."""
    if name.endswith(".urdf") or "/" in name:
        model, visual = _load_file(Path(name), base, meshes)
    elif name in known_robots():
        model, visual = _load_named(name, meshes)
    else:
        remedy = "A URDF file is given by its path, ending in .urdf."
        raise UnknownName("robot", name, known_robots(), remedy)
    held = ""
    if base == "free" and not floats(model):
        raise BadRobot(name, "", "its base is fixed", "Take ArmPlant, or a robot that floats.")
    if base == "held" and floats(model):
        held = model.names[1]
        try:
            model, visual = pin.buildReducedModel(model, visual, [1], pin.neutral(model))
        except ValueError as error:
            raise BadRobot(
                name, f"joint {held}", f"Pinocchio cannot hold its base: {error}", "Take another."
            ) from error
    return model, visual, held


def _load_file(path: Path, base: Base, meshes: bool) -> tuple[pin.Model, Any]:
    if not path.is_file():
        raise BadRobot(str(path), "", "there is no such file", "Give the path of a URDF file.")
    try:
        root = (pin.JointModelFreeFlyer(),) if base == "free" else ()
        model = pin.buildModelFromUrdf(str(path), *root)
    except Exception as error:  # Pinocchio raises ValueError, RuntimeError and its own
        raise BadRobot(
            str(path), "", f"Pinocchio cannot read it: {error}", "Mend the URDF."
        ) from error
    if not meshes:
        return model, pin.GeometryModel()
    try:
        visual = pin.buildGeomFromUrdf(
            model, str(path), pin.GeometryType.VISUAL, package_dirs=[str(path.parent)]
        )
    except (ValueError, RuntimeError):  # meshes that are not there: the dynamics do not need them
        visual = pin.GeometryModel()
    return model, visual


def _load_named(name: str, meshes: bool) -> tuple[pin.Model, Any]:
    import example_robot_data

    try:
        with contextlib.redirect_stdout(io.StringIO()), _reading(meshes):
            robot = example_robot_data.load(name)
    except Exception as error:  # loaders raise whatever their parser does
        raise BadRobot(
            name, "", f"example-robot-data cannot load it: {error}", "Choose another robot."
        ) from error
    return robot.model, robot.visual_model


@contextlib.contextmanager
def _reading(meshes: bool) -> Iterator[None]:
    """Makes Pinocchio's wrapper read what is drawn alone, or no mesh: loaders ask for all."""
    build: Any = robot_wrapper.buildModelsFromUrdf
    kinds = [pin.GeometryType.VISUAL] if meshes else []
    boxes = coal.MeshLoader(coal.NODE_TYPE.BV_OBB)  # the quickest that shows its triangles

    def build_less(*args: Any, **options: Any) -> tuple[Any, Any, Any]:
        model, *visual = build(*args, **options, meshLoader=boxes, geometry_types=kinds)
        return model, pin.GeometryModel(), visual[0] if visual else pin.GeometryModel()

    robot_wrapper.buildModelsFromUrdf = build_less
    try:
        yield
    finally:
        robot_wrapper.buildModelsFromUrdf = build


def check_joints(name: str, model: pin.Model) -> None:
    """Accepts trees of 1-DOF joints only, on a free flyer or not.

    Raises:
        BadRobot: another joint has more than one degree of freedom, or there is none.
    """
    if model.nv == 0:
        raise BadRobot(name, "", "it has no moving joint", "Choose a robot that moves.")
    for i in range(2 if floats(model) else 1, model.njoints):
        kind = model.joints[i].shortname()
        if model.joints[i].nv != 1:
            raise BadRobot(
                name,
                f"joint {model.names[i]}",
                f"{kind} has {model.joints[i].nv} degrees of freedom",
                "A robot is a tree of revolute and prismatic joints.",
            )


def check_inertias(name: str, model: pin.Model) -> None:
    """Accepts links a real body could have: positive mass, triangle inequality of the moments.

    Raises:
        BadRobot: with the link at fault.
    """
    for i in range(1, model.njoints):
        part = f"link of joint {model.names[i]}"
        inertia = model.inertias[i]
        numbers = inertia.toDynamicParameters()
        if not np.isfinite(numbers).all():
            raise BadRobot(name, part, "its inertia is not finite", "Mend the URDF.")
        if inertia.mass <= 0:
            raise BadRobot(
                name, part, f"its mass is {inertia.mass:g} kg", "Give it an <inertial> of mass > 0."
            )
        moments = np.linalg.eigvalsh(inertia.inertia)
        if moments[0] <= 0 or moments[0] + moments[1] < moments[2] * (1 - 1e-6):
            raise BadRobot(
                name,
                part,
                f"no body has the principal moments {', '.join(f'{x:.3g}' for x in moments)} kg·m²",
                "They must be positive and each at most the sum of the other two: mend <inertia>.",
            )
