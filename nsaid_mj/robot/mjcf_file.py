"""MJCF files, with or without their meshes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import mujoco
from lxml import etree
from lxml.etree import _Element as Node

from ..errors import BadRobot
from .findings import Finding
from .mjcf_edit import bodies_of_file, joints_of_file
from .mjcf_inertials import check_inertials
from .mjcf_numbers import check_numbers
from .xml import read_xml

_REMEDY = "Correct the file; MuJoCo's `simulate` must be able to load it."


def compile_file(path: Path) -> tuple[Any, Any, list[Finding]]:
    """Compiles an MJCF or .mjb file.

    Mesh and texture files that are not there are left out, and inertias that MuJoCo would reject
    are moved inside the cone of physical ones.

    Returns:
        MuJoCo's specification (None for .mjb), the compiled model, and what was changed.

    Raises:
        BadRobot: MuJoCo rejects the file, or accepts a number that no robot has.
    """
    try:
        if path.suffix.lower() == ".mjb":
            mj = mujoco.MjModel.from_binary_path(str(path))
            check_numbers(str(path), mj)
            return None, mj, []
        spec = mujoco.MjSpec.from_file(str(path))
        missing = _without_missing_files(spec, path.parent)
        findings = [*_note(path, missing), *check_inertials(spec)]
        mj = spec.compile()
        mj.names.decode()
        check_numbers(str(path), mj)
        return spec, mj, findings
    except UnicodeDecodeError as error:
        raise BadRobot(str(path), "", f"it is not UTF-8: {error}", "Save it as UTF-8.") from error
    except (ValueError, RuntimeError) as error:
        raise BadRobot(str(path), "", f"MuJoCo rejects it: {error}", _REMEDY) from error


def _without_missing_files(spec: Any, folder: Path) -> list[str]:
    """Removes meshes and textures whose files are not there; returns the names of the files."""
    missing = []
    for mesh in list(spec.meshes):
        if mesh.file and not _exists(mesh.file, folder, spec.meshdir):
            missing.append(mesh.file)
            for geom in [g for g in spec.geoms if g.meshname == _name(mesh)]:
                spec.delete(geom)
            spec.delete(mesh)
    for texture in list(spec.textures):
        files = [file for file in [texture.file, *texture.cubefiles] if file]
        gone = [file for file in files if not _exists(file, folder, spec.texturedir)]
        if gone:
            missing += gone
            for material in spec.materials:
                material.textures = ["" if t == texture.name else t for t in material.textures]
            spec.delete(texture)
    return missing


def _name(mesh: Any) -> str:
    return mesh.name or Path(mesh.file).stem


def _exists(file: str, folder: Path, inside: str) -> bool:
    return any(os.path.isfile(folder / part / file) for part in (inside, ""))


def _note(path: Path, missing: list[str]) -> list[Finding]:
    if not missing:
        return []
    others = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
    return [
        Finding(
            "note",
            "mesh_missing",
            path.name,
            f"{len(missing)} mesh and texture files were not found ({missing[0]}{others}), so "
            "these geoms are not drawn; masses must come from <inertial>",
            "Put the files where the MJCF expects them, to see them.",
            {"files": missing},
        )
    ]


def own_file(path: Path, spec: Any, mj: Any, findings: list[Finding]) -> tuple[Node, bool]:
    """The content of an MJCF file, to be edited, with included files in their places.

    Args:
        path: of the file.
        spec: its specification.
        mj: its compiled model.
        findings: on files that are missing, whose meshes and textures are removed.

    Returns:
        The root, and whether it is the file's own. Where elements stand for several bodies, as
        `<replicate>` and `<attach>` do, it is what MuJoCo writes, with six digits.
    """
    root, _ = read_xml(path)
    while (include := next(root.iter("include"), None)) is not None:
        parent = include.getparent()
        assert parent is not None  # the root is <mujoco>
        at = parent.index(include)
        parent[at : at + 1] = list(read_xml(path.parent / include.get("file", ""))[0])
    for finding in findings:
        if finding.code == "mesh_missing":
            _without_files(root, finding.data["files"])  # type: ignore[arg-type]  # a list
    own = [joint.get("name", "") for joint in joints_of_file(root)]
    driven = [a for section in root.findall("actuator") for a in section.iterchildren("*")]
    exact = (
        own == [mj.joint(j).name for j in range(mj.njnt)]
        and len(bodies_of_file(root)) == mj.nbody - 1
        and len(driven) == mj.nu
    )
    return (root, True) if exact else (etree.fromstring(spec.to_xml()), False)


def _without_files(root: Node, missing: list[str]) -> None:
    """Removes meshes and textures of some files, and what shows them."""
    gone = [e for e in root.iter("mesh", "texture") if set(e.attrib.values()) & set(missing)]
    for asset in gone:
        name = asset.get("name") or Path(asset.get("file", "")).stem
        if asset.tag == "texture":
            for material in root.iter("material"):
                if material.get("texture") == name:
                    del material.attrib["texture"]
        else:
            gone = [*gone, *(geom for geom in root.iter("geom") if geom.get("mesh") == name)]
    for element in gone:
        parent = element.getparent()
        if parent is not None:
            parent.remove(element)
