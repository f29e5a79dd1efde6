"""MJCF files, with or without their meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco

from ..errors import BadRobot
from .findings import Finding
from .mjcf_inertials import check_inertials

_REMEDY = "Correct the file; MuJoCo's `simulate` must be able to load it."


def compile_file(path: Path) -> tuple[Any, Any, list[Finding]]:
    """Compiles an MJCF or .mjb file.

    Mesh and texture files that are not there are left out, and inertias that MuJoCo would reject
    are moved inside the cone of physical ones.

    Returns:
        MuJoCo's specification (None for .mjb), the compiled model, and what was changed.

    Raises:
        BadRobot: MuJoCo rejects the file.
    """
    try:
        if path.suffix.lower() == ".mjb":
            return None, mujoco.MjModel.from_binary_path(str(path)), []
        spec = mujoco.MjSpec.from_file(str(path))
        missing = _without_missing_files(spec, path.parent)
        findings = [*_note(path, missing), *check_inertials(spec)]
        mj = spec.compile()
        mj.names.decode()
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
    return any((folder / part / file).is_file() for part in (inside, ""))


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
