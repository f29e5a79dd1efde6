"""The data between reading and fitting: the segments of a robot's logs."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base import Finding
from ...core import Log
from ...robots import RobotModel
from .mapping import ContactMap, Imu, Vehicle
from .phases import LogPhase


class LogSegment(NamedTuple):
    """A stretch of a log without gaps, resampled to a constant rate."""

    # t [s], q, v, u of N samples in the system's own order and units. q are one coordinate for each
    # joint (N, n) for a tree of joints on a fixed base (angles [rad], also of continuous joints, or
    # travels [m]), and the system's own (N, m) for a vehicle
    log: Log
    # (N, n) whether a fit may use the row of a velocity: neither at rest nor saturated, nor
    # interpolated across a drop-out or an outlier
    usable: NDArray[np.bool_]
    source: str  # file name
    rows: tuple[int, int]  # (first, last) row of the file, for messages
    # (N, 10 + f) of a walking robot's IMU: orientation x, y, z, w, angular velocity [rad/s] and
    # specific force [m/s²] along the IMU's own axes, and of f sensors in its feet, in any unit;
    # None of a robot on a fixed base
    imu: NDArray[np.float64] | None = None
    # (N, 3) specific force of a vehicle along its axes [m/s²]; None if it is not measured or needed
    specific: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Recordings:
    """All segments of one or more logs, at one rate."""

    segments: tuple[LogSegment, ...]  # in order of files and time; at least one
    rate: float  # samples per second
    # (n_u,) unit of each command, such as "A", "N·m" or "" if unknown
    command_units: tuple[str, ...]
    findings: tuple[Finding, ...] = ()  # how the data were processed, and what was noticed
    vehicle: Vehicle | None = None  # how pose and twist were read; None for joints
    phases: tuple[LogPhase, ...] = ()  # of all logs, those left out as well; none if not prepared
    # (2, n) gains of the measured positions and velocities in the commands, of motors under a PD
    # law: they act at once, while what else the commands hold may act late; None without feedback
    feedback: NDArray[np.float64] | None = None
    imu: Imu | None = None  # how the IMU of a walking robot was read; None on a fixed base
    contacts: ContactMap = field(default_factory=ContactMap)  # feet of such a robot
    filled: int = 1  # rows per measured one: more where splines lie between these
    timed: bool = False  # whether the map states the clock: by its scale, 1 of one that is right

    @property
    def turns_only(self) -> bool:
        """Whether the rows are those of a vehicle's rotation alone: no translation is measured."""
        return self.vehicle is not None and self.vehicle.turns_only

    def driven(self, robot: RobotModel) -> list[int]:
        """Numbers of the joints with a motor, from 0.

        A joint has none if it is passive in the model file and has no command in the logs.
        """
        commanded = np.any([np.any(s.log.u != 0.0, axis=0) for s in self.segments], axis=0)
        passive = [joint in robot.passive for joint in robot.joints]
        return [int(j) for j in np.flatnonzero(commanded | ~np.array(passive, bool))]
