"""Angles of motors before their gears, told from angles of joints by the model's weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from ...base import Finding
from ...core import number
from ...robots import RobotModel
from .causes import DEGREES
from .evidence import LogMotion, misfit, scaled
from .retiming import BentLinks

_FITS = 0.05  # error of the commands up to which positions are not doubted
_TRAVEL = np.pi  # of a joint, at least, for which a gear is looked for [rad]
_RATIOS = np.geomspace(3.0, 300.0, 24)  # of robots' gears
_HALF = 0.5  # ratio of errors above which there is no gear
_TOLD = 0.2  # product of the joints' ratios of errors below which a gear is certain
_SURE = 0.6  # such a product, over the errors in degrees, below which these are not as likely


def motor_side(motion: LogMotion, robot: RobotModel, measured: Sequence[int]) -> Finding | None:
    """The finding that all angles, and velocities that are `measured`, are those of motors.

    Weight depends on the joints' angles: under the ratio of the gears the commands fit far better.
    One ratio is looked for; joints that slide have none. Links may be off as files are, else wrong
    masses would make a gear of 50 of degrees, which are a factor of 57.3. The ratio is told to some
    per cent, so that the finding states no line of map.toml.
    """
    turning = [j for j, unit in enumerate(robot.units) if unit == "rad"]
    plain = misfit(robot, motion, 0.0)
    if np.isnan(plain) or plain < _FITS or not turning:
        return None
    if np.ptp(motion.q[:, turning], axis=0).max() < _TRAVEL:
        return None

    def moved(logarithm: float) -> LogMotion:
        return scaled(turning, float(np.exp(-logarithm)), motion)

    def error(logarithm: float) -> float:
        return BentLinks(robot, moved(logarithm)).error()

    grid = np.log(_RATIOS)
    best = int(np.argmin([misfit(robot, moved(x), 0.0) for x in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = scipy.optimize.minimize_scalar(error, bounds=around, options={"maxiter": 15})
    ratio = float(np.exp(found.x))
    n = len(turning)
    own = error(0.0)
    told = found.fun < _HALF * own and (found.fun / own) ** n < _TOLD
    if not told or (found.fun / error(np.log(DEGREES))) ** n > _SURE:
        return None
    words = number(ratio, significant=2)
    text = f"the positions are angles of the motors, before gears of about {words}: with them "
    text += f"divided by {words} the commands fit the model with {100 * found.fun:.2g} % error, "
    text += f"as they are with {100 * own:.2g} %"
    keys = "`position`" if not set(turning) & set(measured) else "`position` and `velocity`"
    remedy = f"Set {keys} under `[factors]` in map.toml to 1/ratio, with the ratio of the gears' "
    remedy += f"data sheet, such as {1 / ratio:.2g} for {words}."
    return Finding("refusal", "motor_side", "", text, remedy, {"ratio": ratio})
