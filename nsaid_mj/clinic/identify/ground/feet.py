"""Where a robot touches the ground, and where its IMU sits, from its model file.

Feet are those that the map names; else geoms, sites, links or frames called foot, toe or sole; else
the ends of those limbs that reach lowest in the file's pose. A single sphere touches the ground at
its lowest point; several geoms, or a box, on the last link of six joints or more are a flat foot.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from lxml import etree

from ....base import Finding, InputFile, UnknownName, pin
from ....core import Array, ContactPoint
from ....robots import BadRobot, MjcfFile, RobotModel
from ...logs.mapping import ContactMap, Imu

_FOOT = re.compile(r"foot|feet|toe|sole", re.IGNORECASE)
_LOW = 0.15  # of the robot's height, within which the ends of limbs are feet
_JOINTS_OF_FLAT = 6  # of a limb whose foot can exert any force and torque
_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)


class Place(NamedTuple):
    """A named place on a robot's link."""

    name: str
    kind: str  # geom, site, link or frame
    joint: int  # number of the joint that moves the link, in Pinocchio's model
    placement: pin.SE3  # in that joint's frame
    radius: float = 0.0  # of a sphere [m]
    solid: bool = False  # whether it is a shape that can touch
    flat: bool = False  # whether it has a face: a box or a mesh


def feet_of(robot: RobotModel, stated: ContactMap) -> tuple[list[ContactPoint], Finding]:
    """The feet of a robot whose base floats, and what was found, in words.

    Raises:
        UnknownName: the map names a foot that the model file lacks.
        BadRobot: no feet were found.
    """
    places = list(places_of(robot))
    if stated.feet:
        chosen = [[_named(places, name)] for name in stated.feet]
        how = "in the map"
    else:
        chosen = _called_feet(robot, places)
        how = "by name"
        if not chosen:
            chosen = _lowest(robot, places)
            how = "at the ends of the limbs that reach lowest"
    if not chosen:
        remedy = 'Name them in map.toml: `[contacts]`, `feet = ["…"]`, geoms, sites or links.'
        raise BadRobot(robot.name, "", "no feet were found in the model file", remedy)
    found = [_contact(robot, group, stated) for group in chosen]
    words = ", ".join(_in_words(contact) for contact in found)
    text = f"contact points with the ground, found {how}: {words}; their forces are unknown"
    points = [c.name for c in found if not c.flat and c.radius == 0]
    if points and stated.radius is None:
        remedy = "If they are round, give their radius in map.toml: `[contacts]`, `radius = 0.02`."
        return found, Finding("note", "feet", ", ".join(points), text, remedy)
    return found, Finding("note", "feet", "", text)


def _in_words(contact: ContactPoint) -> str:
    kind = "flat" if contact.flat else f"round, {1e3 * contact.radius:.3g} mm"
    kind = "a point" if not contact.flat and contact.radius == 0 else kind
    return f"{contact.name} ({kind})"


def _contact(robot: RobotModel, group: Sequence[Place], stated: ContactMap) -> ContactPoint:
    """The contact of places on one link."""
    spheres = [place for place in group if place.radius > 0]
    limb = 0
    joint = group[0].joint
    while joint > 1:
        limb += 1
        joint = int(robot.model.parents[joint])
    solid = [place for place in group if place.solid]
    face = any(place.flat for place in solid) or len(solid) > 1
    flat = stated.flat
    if flat is None:
        flat = limb >= _JOINTS_OF_FLAT and (face or not solid)
    centres = [place.placement.translation for place in (spheres if spheres else group)]
    radius = stated.radius
    if radius is None:
        radius = max((place.radius for place in spheres), default=0.0)
    return ContactPoint(
        group[0].joint - 1,
        np.mean(centres, axis=0),
        0.0 if flat else radius,
        flat,
        name=group[0].name,
    )


def _named(places: Sequence[Place], name: str) -> Place:
    own = [place for place in places if place.name == name]
    own.sort(key=lambda place: -place.radius)
    if not own:
        raise UnknownName("foot", name, [place.name for place in places])
    return own[0]


def _called_feet(robot: RobotModel, places: Sequence[Place]) -> list[list[Place]]:
    """Places called feet, by the last link of each limb that has some."""
    last = _ends(robot)
    named = [place for place in places if place.joint in last and _FOOT.search(place.name)]
    found = []
    for joint in last:
        own = [place for place in named if place.joint == joint]
        shapes = [place for place in own if place.solid]
        sites = [place for place in own if place.kind == "site"]
        spheres = [place for place in shapes if place.radius > 0]
        if own:
            near = _spheres_near(places, joint) if not shapes else []
            found.append(spheres or shapes or near or sites or own)
    return found


def _spheres_near(places: Sequence[Place], joint: int) -> list[Place]:
    """The spheres on a link whose feet are named without a shape."""
    return [place for place in places if place.joint == joint and place.radius > 0]


def _ends(robot: RobotModel) -> list[int]:
    """The joints that move the last links of all limbs."""
    parents = {int(robot.model.parents[joint]) for joint in range(1, robot.model.njoints)}
    return [joint for joint in range(2, robot.model.njoints) if joint not in parents]


def _lowest(robot: RobotModel, places: Sequence[Place]) -> list[list[Place]]:
    """The shapes at the ends of the limbs that reach lowest while all joints are at home."""
    model = robot.model
    data = model.createData()
    q = pin.neutral(model)
    pin.forwardKinematics(model, data, q)
    groups = []
    for joint in _ends(robot):
        own = [place for place in places if place.joint == joint and place.solid]
        spheres = [place for place in own if place.radius > 0]
        if own:
            groups.append(spheres or own)
    if not groups:
        return []
    heights = [
        min(float(data.oMi[p.joint].act(p.placement.translation)[2]) - p.radius for p in group)
        for group in groups
    ]
    height = max(0.0 - min(heights), 1e-3)
    return [g for g, low in zip(groups, heights, strict=True) if low < min(heights) + _LOW * height]


def places_of(robot: RobotModel) -> Iterator[Place]:
    """The geoms, sites, links and frames of a model file."""
    assert robot.file is not None
    model = robot.model
    frames = {f.name: f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint}
    if robot.kind == "mjcf":
        yield from _of_mjcf(MjcfFile(robot.file).model, frames)
        return
    shapes = _collisions(etree.fromstring(InputFile(robot.file).read()))
    for name, frame in frames.items():
        own = shapes.get(name, [])
        for placement, radius in own:
            at = frame.placement * placement
            yield Place(name, "link", frame.parentJoint, at, radius, True, radius == 0)
        if not own:
            yield Place(name, "link", frame.parentJoint, frame.placement)
    for frame in model.frames:
        if frame.name not in frames and frame.parentJoint:
            yield Place(frame.name, "frame", frame.parentJoint, frame.placement)


def _of_mjcf(mj: Any, frames: dict[str, pin.Frame]) -> Iterator[Place]:
    def at(body: int, position: Array, quaternion: Array) -> tuple[int, pin.SE3] | None:
        frame = frames.get(mj.body(body).name or f"body {body}")
        if frame is None:
            return None
        w, x, y, z = quaternion
        turn = pin.Quaternion(w, x, y, z).matrix()
        return frame.parentJoint, frame.placement * pin.SE3(turn, position)

    for g in range(mj.ngeom):
        place = at(int(mj.geom_bodyid[g]), mj.geom_pos[g], mj.geom_quat[g])
        solid = bool(mj.geom_contype[g] or mj.geom_conaffinity[g])
        if place is not None and solid:
            sphere = int(mj.geom_type[g]) == _SPHERE
            faces = (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH)
            flat = int(mj.geom_type[g]) in map(int, faces)
            radius = float(mj.geom_size[g, 0]) if sphere else 0.0
            name = mj.geom(g).name or mj.body(int(mj.geom_bodyid[g])).name
            yield Place(name, "geom", *place, radius, True, flat)
    for s in range(mj.nsite):
        place = at(int(mj.site_bodyid[s]), mj.site_pos[s], mj.site_quat[s])
        if place is not None:
            yield Place(mj.site(s).name, "site", *place)
    for name, frame in frames.items():
        yield Place(name, "link", frame.parentJoint, frame.placement)


def _collisions(root: Any) -> dict[str, list[tuple[pin.SE3, float]]]:
    """Poses and radii of the links' collision shapes in a URDF; radius 0 of all but spheres."""
    found: dict[str, list[tuple[pin.SE3, float]]] = {}
    for link in root.findall("link"):
        for shape in link.findall("collision"):
            origin = shape.find("origin")
            xyz = origin.get("xyz", "0 0 0") if origin is not None else "0 0 0"
            rpy = origin.get("rpy", "0 0 0") if origin is not None else "0 0 0"
            turn = pin.rpy.rpyToMatrix(np.array(rpy.split(), dtype=np.float64))
            sphere = shape.find("geometry/sphere")
            radius = float(sphere.get("radius", "0")) if sphere is not None else 0.0
            place = pin.SE3(turn, np.array(xyz.split(), dtype=np.float64))
            found.setdefault(link.get("name", ""), []).append((place, radius))
    return found


def imu_pose(robot: RobotModel, imu: Imu) -> tuple[pin.SE3, Finding]:
    """The pose of the IMU in the base's frame, and where it comes from, in words.

    Raises:
        UnknownName: the map names a site or frame that the model file lacks.
        BadRobot: the IMU is not on the base.
    """
    if imu.place is not None:
        turn = pin.rpy.rpyToMatrix(np.radians(imu.turn))
        pose = pin.SE3(turn, np.array(imu.place))
        return pose, Finding("note", "imu_pose", "IMU", f"placed by the map{_at(pose)}")
    places = list(places_of(robot))
    if imu.site is not None:
        place = _named(places, imu.site)
        if place.joint != 1:
            reason = f"{imu.site} is not on the base, but on a link that joints move"
            remedy = "Name a site on the base, or give its `place` in [base]."
            raise BadRobot(robot.name, "", reason, remedy)
        pose = place.placement
        return pose, Finding("note", "imu_pose", "IMU", f"at {imu.site}{_at(pose)}")
    own = [p for p in places if p.joint == 1 and not p.solid and "imu" in p.name.lower()]
    if own:
        pose = own[0].placement
        text = f"at the {own[0].kind} {own[0].name} of the model file{_at(pose)}"
        return pose, Finding("note", "imu_pose", "IMU", text)
    text = "the model file has no site or link called imu; it is assumed at the base's origin, "
    text += "along its axes"
    remedy = (
        "Give its pose in map.toml: `[base]`, `place = [x, y, z]` [m], `turn` [deg]; 5 cm cost "
    )
    remedy += "about 2 % of the gains."
    return pin.SE3.Identity(), Finding("warning", "imu_pose", "IMU", text, remedy)


def _at(pose: pin.SE3) -> str:
    place = ", ".join(f"{x:.3g}" for x in 100 * pose.translation).replace("-", "−")
    return f", ({place}) cm from the base's origin"
