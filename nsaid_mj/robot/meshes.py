"""Mesh files of a URDF: where they are."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from lxml.etree import _Element as Element

from .findings import Finding


def resolve_meshes(root: Element, path: Path) -> list[Finding]:
    """Makes the paths of a URDF's visual meshes absolute, in place; removes those not found.

    `package://` names are looked for in every ancestor folder of the file, in `ROS_PACKAGE_PATH`
    and in `AMENT_PREFIX_PATH`; relative names in every ancestor folder. Collision shapes are
    removed.

    Args:
        root: the URDF.
        path: its file.

    Returns:
        One note on all meshes that were not found, if there are any.
    """
    missing = []
    for link in root.iter("link"):
        for collision in link.findall("collision"):
            link.remove(collision)
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            found = next((p for p in _candidates(name, path) if os.path.isfile(p)), None)
            if found is None:
                missing.append(name)
                link.remove(visual)
            else:
                mesh.set("filename", str(found))
    if not missing:
        return []
    first = f"{missing[0]}" + (f" and {len(missing) - 1} more" if len(missing) > 1 else "")
    return [
        Finding(
            "note",
            "mesh_missing",
            path.name,
            f"{len(missing)} mesh files were not found ({first}), so these links are not drawn; "
            "the dynamics do not need them",
            "Set ROS_PACKAGE_PATH to the folder that contains the package, to see them.",
            {"files": missing},
        )
    ]


def _candidates(name: str, path: Path) -> Iterator[Path]:
    """Places where a mesh may be, the likeliest first."""
    scheme, _, rest = name.rpartition("://")
    rest = unquote(rest) if scheme else rest
    if scheme == "file" or (not scheme and Path(rest).is_absolute()):
        yield Path(rest)
        return
    folders = list(path.resolve().parents)
    if scheme in {"package", "model"}:
        package, _, inside = rest.partition("/")
        for folder in [*folders, *_ros_folders()]:
            yield folder / package / inside
            if folder.name == package:
                yield folder / inside
        rest = inside
    for folder in folders:
        yield folder / rest


def _ros_folders() -> Iterator[Path]:
    """Folders in which ROS 1 and ROS 2 look for packages."""
    for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for entry in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(entry) / inside
