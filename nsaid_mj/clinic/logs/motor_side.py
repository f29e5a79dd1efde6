"""Angles of motors before their gears, told from angles of joints by the model's weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from ...base import Finding
from ...core import number
from ...robots import RobotModel
from .causes import DEGREES, of_joints
from .evidence import LogMotion, misfit, scaled
from .remedies import remedy_of

_FITS = 0.05  # error of the commands up to which positions are not doubted
_TRAVEL = np.pi  # of a joint, at least, for which a gear is looked for [rad]
_RATIOS = np.geomspace(3.0, 300.0, 24)  # of robots' gears
_TOLD = 0.2  # product of the joints' ratios of errors below which a gear is certain
_DEGREES_NEAR = 0.05  # relative difference from 57.3 at which degrees are likelier than a gear


def motor_side(motion: LogMotion, robot: RobotModel, measured: Sequence[int]) -> Finding | None:
    """The finding that all angles, and velocities that are `measured`, are those of motors.

    Weight depends on the joints' angles: under the ratio of the gears the commands fit far better.
    One ratio is looked for; joints that slide have none.
    """
    turning = [j for j, unit in enumerate(robot.units) if unit == "rad"]
    plain = misfit(robot, motion, 0.0)
    if np.isnan(plain) or plain < _FITS or not turning:
        return None
    if np.ptp(motion.q[:, turning], axis=0).max() < _TRAVEL:
        return None

    def error(logarithm: float) -> float:
        return misfit(robot, scaled(turning, float(np.exp(-logarithm)), motion), 0.0)

    grid = np.log(_RATIOS)
    best = int(np.argmin([error(x) for x in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = scipy.optimize.minimize_scalar(error, bounds=around, options={"maxiter": 15})
    ratio = float(f"{np.exp(found.x):.3g}")
    told = (found.fun / plain) ** len(turning) < _TOLD
    if not told or abs(np.log(ratio / DEGREES)) < _DEGREES_NEAR:
        return None
    words = number(ratio, significant=3)
    text = f"the positions are angles of the motors, before gears of about {words}: with them "
    text += f"divided by {words} the commands fit the model with {100 * found.fun:.2g} % error, "
    text += f"as they are with {100 * plain:.2g} %"
    factor = float(f"{1 / ratio:.6g}")
    changes = {"factors.position": of_joints(robot, turning, factor)}
    if fast := [j for j in turning if j in measured]:
        changes["factors.velocity"] = of_joints(robot, fast, factor)
    remedy = f"{remedy_of(changes)} Where the data sheet has the ratio, state it as `ratio`."
    data = {"ratio": ratio, "map": changes}
    return Finding("refusal", "motor_side", "", text, remedy, data)
