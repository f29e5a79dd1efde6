"""The one entry to all choices: a robot and its logs become rows of the best structure."""

from collections.abc import Callable

from ....robots import RobotModel
from ...logs.recordings import Recordings
from ..ground.search import structured_ground
from ..result import Options, Structured
from .joint_search import structured_arm
from .vehicle_search import structured_vehicle


def structured(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    report: Callable[[str], None],
) -> Structured:
    """Chooses what `options.OPTIONS` lists for a robot, and makes the rows of its fit.

    `recordings` are training logs, `validation` is a log excluded from the fit, or None; `report`
    is called with the name of every stage.
    """
    search = structured_arm if robot.jointed else structured_vehicle
    if robot.floating:
        search = structured_ground
    return search(robot, recordings, validation, options, report)
