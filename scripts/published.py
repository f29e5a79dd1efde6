"""Published parameters of one robot's servos: which share of their disagreement can logs decide?

    python scripts/published.py FOLDER   # with so101.xml and logs NAME.csv.gz

Makes docs/published.png, and FOLDER/other.xml with another project's values, for `nsaid compare`.
Sets of (kp, kv, armature, friction) of all joints are compared in logarithms. Their difference has
a part along the common scale, which no log decides unless a mass is known; a part along directions
whose 95 % interval in these logs is wider than a factor of two; and a part that they decide.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np

from nsaid_mj.clinic.servos.estimate import JointEstimate, estimate
from nsaid_mj.clinic.servos.identify import servo_logs
from nsaid_mj.core.parameters import Array

OTHER = np.log([48.0, 3.3, 0.068, 0.35])  # another project's servo values, for all joints
PARTS = ("common scale: no log", "not these logs", "these logs decide")
COLOURS = ("#b0b7c3", "#e0a458", "#2a6f97")
TOLD = np.log(2.0)  # half the length of a 95 % interval that decides


def main() -> None:
    """Prints the shares and draws them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    given = servo_logs(folder / "so101.xml", sorted(folder.glob("*.csv.gz")))
    assert given is not None
    found = estimate(given).joints
    sets = {
        "official file": in_file(folder / "so101.xml", given.robot.joints),
        "another project": np.tile(OTHER, len(found)),
        "identified": np.concatenate([values(joint) for joint in found]),
    }
    write_other(folder / "so101.xml", folder / "other.xml")
    projections = undecided(found)
    rows = {}
    print("| sets | rms disagreement, a factor of | " + " | ".join(PARTS) + " |")
    print("|---|---|---|---|---|")
    for one, two in itertools.combinations(sets, 2):
        difference = sets[one] - sets[two]
        shares = [np.sum((P @ difference) ** 2) / np.sum(difference**2) for P in projections]
        rows[f"{one} – {two}"] = shares
        cells = " | ".join(f"{100 * share:.0f} %" for share in shares)
        print(f"| {one} – {two} | {np.exp(np.sqrt(np.mean(difference**2))):.1f} | {cells} |")
    draw(rows, Path(__file__).parents[1] / "docs" / "published.png")


def in_file(path: Path, joints: tuple[str, ...]) -> Array:
    """(4 n,) logarithms of kp, kv, armature and friction of a file's joints, one after another."""
    mj = mujoco.MjModel.from_xml_path(str(path))
    rows = []
    for name in joints:
        dof, servo = mj.joint(name).dofadr[0], mj.actuator(name).id
        kv = mj.dof_damping[dof] - mj.actuator_biasprm[servo, 2]
        friction = mj.dof_frictionloss[dof]
        rows.append([mj.actuator_gainprm[servo, 0], kv, mj.dof_armature[dof], friction])
    return np.log(rows).ravel()


def write_other(path: Path, other: Path) -> None:
    """Writes a file with another project's values on all joints, its damping all in kv."""
    spec = mujoco.MjSpec.from_file(str(path))
    kp, kv, armature, friction = np.exp(OTHER)
    for joint, actuator in zip(spec.joints, spec.actuators, strict=True):
        joint.damping = [0, 0, 0]
        joint.armature, joint.frictionloss = armature, friction
        actuator.gainprm[0], actuator.biasprm[1], actuator.biasprm[2] = kp, -kp, -kv
    spec.compile()
    other.write_text(spec.to_xml())


def values(joint: JointEstimate) -> Array:
    """(4,) logarithms of an estimate's kp, kv, armature and friction."""
    T, f, g, a, _ = joint.x
    return np.array([0.0, T, a, f]) - g


def undecided(joints: tuple[JointEstimate, ...]) -> tuple[Array, Array, Array]:
    """Projections on the common scale, on what the logs do not decide, and on what they do."""
    size = 4 * len(joints)
    A = np.array([[0, 0, -1, 0, 0], [1, 0, -1, 0, 0], [0, 0, -1, 1, 0], [0, 1, -1, 0, 0.0]])
    covariance = np.zeros((size, size))
    for k, joint in enumerate(joints):
        own = slice(4 * k, 4 * k + 4)
        wide = A * joint.quantile[: A.shape[1]]
        covariance[own, own] = wide @ joint.covariance @ wide.T
        if not joint.gravity:
            covariance[own, own] += 100.0
    scale = np.full((size, size), 1 / size)
    rest = np.eye(size) - scale
    variances, directions = np.linalg.eigh(rest @ covariance @ rest)
    vague = directions[:, variances > TOLD**2]
    hidden = rest @ vague @ vague.T @ rest
    return scale, hidden, rest - hidden


def draw(rows: dict[str, list[float]], path: Path) -> None:
    """Draws the shares as bars."""
    figure, axes = plt.subplots(figsize=(7.5, 2.4), layout="constrained")
    left = np.zeros(len(rows))
    for part, colour, shares in zip(PARTS, COLOURS, np.array(list(rows.values())).T, strict=True):
        axes.barh(list(rows), 100 * shares, left=left, color=colour, label=part)
        left += 100 * shares
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel(
        "share of the squared disagreement of ln kp, ln kv, ln armature, ln friction [%]"
    )
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main()
