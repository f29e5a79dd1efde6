"""Which hub for robot descriptions: MuJoCo's `MjSpec`, or Pinocchio's `Model`?

Every URDF of assets/ and example-robot-data is taken into MuJoCo on both ways: read by MuJoCo
itself with shapes removed, and by Pinocchio with one MuJoCo body per joint made from its model.
Mass matrix and bias forces are compared with Pinocchio's. Every MJCF of assets/ goes the opposite
way, into Pinocchio's model.

    python scripts/robot_hub.py
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from lxml import etree

from nsaid_mj.plants.world.coordinates import JointMap
from nsaid_mj.plants.world.quiet import quiet
from nsaid_mj.resources import example_robots, folder
from nsaid_mj.robot.tree import rigid_tree, tree_spec

_STEP = 1e-3  # any: nothing is simulated [s]
_EXACT = 1e-9  # relative difference of M and bias below which both engines agree


def bare(path: Path) -> str:
    """A URDF without shapes and transmissions."""
    root = etree.parse(str(path)).getroot()
    for element in list(root.iter("visual", "collision", "transmission", "gazebo")):
        element.getparent().remove(element)
    return etree.tostring(root, encoding="unicode")


def apart(model: pin.Model, mj: Any) -> float:
    """The largest relative difference of mass matrix and bias at random states."""
    data, theirs, names = model.createData(), mujoco.MjData(mj), list(model.names)[1:]
    joints, rng, worst = JointMap(mj, names), np.random.default_rng(0), 0.0
    for _ in range(3):
        angles, v = rng.uniform(-1, 1, (2, model.nv))
        joints.write(theirs, angles, v)
        mujoco.mj_forward(mj, theirs)
        q = pin.neutral(model)
        if model.joints[1].nv == 6:
            pose = pin.SE3(pin.exp3(angles[3:6]), angles[:3])
            q = pin.integrate(model, q, np.r_[np.zeros(6), angles[6:]])
            q[:7] = pin.SE3ToXYZQUAT(pose)
        else:
            q = pin.integrate(model, q, angles)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        bias = pin.nonLinearEffects(model, data, q, v)
        force = max(np.abs(bias).max(), np.abs(M).max())
        worst = max(worst, np.abs(M - joints.mass_matrix(mj, theirs)).max() / np.abs(M).max())
        worst = max(worst, np.abs(bias - joints.bias(mj, theirs)).max() / force)
    return worst


def compiled(text: str) -> Any:
    """MuJoCo's model of a URDF that MuJoCo reads itself."""
    return mujoco.MjSpec.from_string(text).compile()


def joined(model: pin.Model) -> Any:
    """MuJoCo's model of a Pinocchio model."""
    return tree_spec(model, _STEP).compile()


def outcome(compiled: Any, model: pin.Model) -> str:
    """Whether MuJoCo compiles a specification, and with the same dynamics."""
    try:
        mj = compiled()
        difference = apart(model, mj)
    except (ValueError, RuntimeError, KeyError, np.linalg.LinAlgError) as error:
        return " ".join(str(error).split())[:60]
    return "same" if difference < _EXACT else f"differs by {difference:.1g}"


def main() -> None:
    """Prints one row per file, and how many files each way gets right."""
    from example_robot_data.robots_loader import getModelPath

    files = {path.stem: path for path in sorted(folder("assets").rglob("*.urdf"))}
    for name, loader in example_robots().items():
        relative = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
        files.setdefault(name, Path(getModelPath(str(relative))) / relative)
    right: dict[str, int] = {"MjSpec": 0, "pin.Model": 0, "MJCF": 0}
    with quiet():
        for name, path in files.items():
            if path.suffix != ".urdf":
                print(f"{name:32} is {path.suffix}")
                continue
            text = bare(path)
            model = pin.buildModelFromXML(text)
            if not model.nv:
                continue
            found = {
                "MjSpec": outcome(partial(compiled, text), model),
                "pin.Model": outcome(partial(joined, model), model),
            }
            for way, result in found.items():
                right[way] += result == "same"
            print(f"{name:32} MjSpec: {found['MjSpec']:60}  pin.Model: {found['pin.Model']}")
        for path in sorted(folder("assets").glob("*/*.xml")):
            if path.stem != path.parent.name:  # the looks of a vehicle
                continue
            mj = mujoco.MjSpec.from_file(str(path)).compile()
            result = outcome(lambda mj=mj: mj, rigid_tree(mj, "")) if mj.njnt else "no joint"
            right["MJCF"] += result == "same"
            print(f"{path.parent.name:32} MJCF into pin.Model: {result}")
    print(right, "of", len(files), "URDF files")


if __name__ == "__main__":
    main()
