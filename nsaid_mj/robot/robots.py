"""Loads and checks robot descriptions: packed ones, those of example-robot-data, or URDF files."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from ..errors import BadRobot, UnknownName
from ..resources import (
    MORE_ROBOTS,
    example_robots,
    has_example_robots,
    known_robots,
    packed_robots,
)
from ..structure.joints import floats
from ..structure.optional import coal, pin
from .urdf_checks import check_masses, check_urdf, parse, read_text, warn_of_motors

Base = Literal["held", "free"]
"""Whether a floating base is fixed to a stand or free."""


@dataclass(frozen=True)
class Robot:
    """A robot's description.

    Attributes:
        name: its name, or the path of its URDF file.
        base: whether a floating base is held or free.
        model: Pinocchio's model.
        held: name of the floating joint that is fixed, "" if there is none.
    """

    name: str
    base: Base
    model: pin.Model
    held: str = ""

    @cached_property
    def visual(self) -> Any:
        """Pinocchio's visual geometry, loaded on first access: a UR5's meshes take 0.3 s."""
        return _described(self.name, self.base, meshes=True)[1]


def load_robot(name: str, base: Base = "held") -> Robot:
    """Loads a robot of revolute, prismatic and continuous joints.

    Args:
        name: of a packed robot or one of example-robot-data, or the path of a URDF file.
        base: whether a floating base is held or free. With `free`, a URDF file's root floats.

    Raises:
        MissingPackage: Pinocchio is not installed.
        UnknownName: there is no robot of this name; near matches are listed.
        BadRobot: it cannot be loaded, has a joint of another kind or a link of physically
            impossible inertia, or its base cannot float.
    """
    model, _, held = _described(name, base, meshes=False)
    check_joints(name, model)
    check_inertias(name, model)
    return Robot(name, base, model, held)


def _described(name: str, base: Base, meshes: bool) -> tuple[pin.Model, Any, str]:
    """The model, its visual geometry (empty without `meshes`), and the name of the held joint."""
    if name.endswith(".urdf") or "/" in name:
        model, visual = _load_file(Path(name), base, meshes)
    elif name in packed_robots():
        model, visual = _load_file(packed_robots()[name], "held", meshes)
    elif name in example_robots():
        model, visual = _load_named(name, meshes)
    else:
        remedy = "A URDF file is given by its path, ending in .urdf."
        remedy += "" if has_example_robots() else f" {MORE_ROBOTS}"
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
        raise BadRobot(str(path), "", "no such file", "Give the path of a URDF file.")
    build = pin.buildModelFromXML  # outside of `try`: Pinocchio may be missing
    root = parse(path, read_text(path)[0])
    check_urdf(path, root)
    check_masses(path, root)
    if path not in packed_robots().values():  # whose joints are known
        warn_of_motors(path, root)
    try:
        joint = (pin.JointModelFreeFlyer(),) if base == "free" else ()
        model = build(ElementTree.tostring(root, encoding="unicode"), *joint)
    except Exception as error:  # Pinocchio raises ValueError, RuntimeError and its own
        raise BadRobot(
            str(path), "", f"Pinocchio cannot read it: {error}", "Correct the URDF."
        ) from error
    if not meshes:
        return model, pin.GeometryModel()
    try:
        visual = pin.buildGeomFromUrdf(
            model,
            str(path),
            pin.GeometryType.VISUAL,
            package_dirs=[str(path.parent), str(path.parent.parent)],
            mesh_loader=coal.MeshLoader(coal.NODE_TYPE.BV_OBB),  # fastest that exposes triangles
        )
    except (ValueError, RuntimeError):  # mesh files are missing: the dynamics do not need them
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
    """Makes Pinocchio's wrapper load visual meshes only, or none; loaders request all geometry."""
    from pinocchio import robot_wrapper

    build: Any = robot_wrapper.buildModelsFromUrdf
    kinds = [pin.GeometryType.VISUAL] if meshes else []
    boxes = coal.MeshLoader(coal.NODE_TYPE.BV_OBB)  # the fastest type that exposes its triangles

    def build_less(*args: Any, **options: Any) -> tuple[Any, Any, Any]:
        model, *visual = build(*args, **options, meshLoader=boxes, geometry_types=kinds)
        return model, pin.GeometryModel(), visual[0] if visual else pin.GeometryModel()

    robot_wrapper.buildModelsFromUrdf = build_less
    try:
        yield
    finally:
        robot_wrapper.buildModelsFromUrdf = build


def check_joints(name: str, model: pin.Model) -> None:
    """Checks that a model is a tree of 1-DOF joints, possibly on a free flyer.

    Raises:
        BadRobot: a joint other than the free flyer has several degrees of freedom, or no joint
            moves.
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
    """Checks that links have positive mass and moments that satisfy the triangle inequality.

    Raises:
        BadRobot: names the first link whose inertia no body can have.
    """
    for i in range(1, model.njoints):
        part = f"link of joint {model.names[i]}"
        inertia = model.inertias[i]
        numbers = inertia.toDynamicParameters()
        if not np.isfinite(numbers).all():
            raise BadRobot(name, part, "its inertia is not finite", "Correct the URDF.")
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
                "Correct <inertia>: each must be positive and at most the sum of the other two.",
            )
