"""An identification of servos made up: two joints that lift an arm, one of them loaded."""

import numpy as np
import pinocchio as pin

from nsaid_mj.clinic.identify.loads import Load
from nsaid_mj.clinic.servos.estimate import JointEstimate, MassScale
from nsaid_mj.clinic.servos.result import (
    ServoIdentification,
    masses,
    parameters,
    servo,
    weighed,
)
from nsaid_mj.robots.loading import load_tree
from nsaid_mj.robots.model import RobotModel

NAMES = ("lift", "elbow")


def identified_servos(used, file=None):
    """The result.

    Args:
        used: (N,) 1 of samples in use.
        file: of the model, with two joints; None for one made up.
    """
    none, model, last = np.zeros(2), pin.Model(), 0
    for name in NAMES:
        last = model.addJoint(last, pin.JointModelRX(), pin.SE3.Identity(), name)
    robot = RobotModel("arm", None, "mjcf", model, NAMES, none, none, none, none + 1, none + np.inf)
    if file is not None:
        robot = load_tree(str(file))
    x, C, quantile = np.log([0.06, 0.02, 0.08, 2e-3, 0.015]), 0.01 * np.eye(5), np.full(6, 2.0)
    joints = [JointEstimate(name, x, C, quantile, True, 0.0, 2e-3, 2e-2) for name in NAMES]
    scale = MassScale(np.log(1.3), 0.03, 2.0, np.zeros(3), np.full(3, 0.01))
    return ServoIdentification(
        explains="yes",
        verdict="The servo model explains the motion.",
        robot=robot,
        servos=tuple(servo(joint, scale) for joint in joints),
        parameters=tuple(p for k, j in enumerate(joints, 1) for p in parameters(k, j, scale)),
        scale=masses(scale),
        used=used,
        findings=(weighed(Load("b.csv", 0.2), "elbow", scale),),
        seconds=1.0,
    )
