"""MuJoCo's own toolbox, `mujoco.sysid`, on logs of an arm driven by force."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..baselines import Problem
from ..baselines.sysid import BUDGET, sysid
from ..identifiers.cone.prior import drawn_inside
from ..log import SensorLevels
from ..parameters import Array
from ..robot.identified import Identified, with_inertias
from ..structure.joints import JointScales
from ..structure.multibody import CompiledMultibody
from .arms import structured_arm
from .data import Recordings, RobotModel, Segment
from .joints import BASIC
from .links import positions
from .structure import Options

_NOISY = SensorLevels(position=1e-4, velocity=1e-3)  # chunks start at smoothed states


def by_toolbox(
    robot: RobotModel, recordings: Recordings, budget: float = BUDGET
) -> tuple[Identified, Array]:
    """The values that `baselines.sysid.sysid` finds in logs, and (n,) delays of the commands [s].

    It fits links, rotors, viscous and Coulomb friction, and gains. Its start is that of `nsaid
    identify`: the model file's links, and frictions and gains guessed from the log. So are the
    commands' delays and the speeds at which Coulomb friction saturates, which it does not fit.
    Numbers of joints are searched between a tenth of the start and ten times it, within the budget
    of CPU time [s].

    Raises:
        NoEstimate: the toolbox is not installed, or no segment lasts half a second.
        UnusableLog: the logs cannot be used.
    """
    made = structured_arm(robot, recordings, None, Options(columns=BASIC), lambda _: None)
    space, n = made.problem.space, len(robot.joints)
    prior = drawn_inside(space, made.problem.prior, 0.0, np.random.default_rng(0))
    speeds, one = np.array([joint.friction_speed for joint in made.velocities]), np.ones(n)
    rotor, viscous, coulomb, gain = prior[-4 * n :].reshape(4, n)
    masses = prior[: -4 * n : 10]
    scales = JointScales(masses, np.ones_like(masses), viscous, coulomb, gain, one, one, rotor)
    system = CompiledMultibody(robot.model, scales, speeds)
    logs, sign = [delayed(s, made.delays).log for s in recordings.segments], np.sign(robot.gain)
    logs = [log._replace(q=positions(robot.model, log.q), u=log.u * sign) for log in logs]
    theta, _ = sysid(Problem(system, logs[0], prior, _NOISY), budget, logs[1:])
    rotor, viscous, coulomb, gain = theta[-4 * n :].reshape(4, n)
    model = with_inertias(robot.model, theta[: -4 * n].reshape(-1, 10), rotor)
    found = Identified(model, viscous, coulomb, speeds, gain * sign, "mujoco.sysid")
    return found, made.delays


def delayed(segment: Segment, delays: Sequence[float] | Array) -> Segment:
    """A segment whose commands arrive late, by (n,) delays [s]."""
    log = segment.log
    late = [np.interp(log.t - d, log.t, u) for d, u in zip(delays, log.u.T, strict=True)]
    return segment._replace(log=log._replace(u=np.column_stack(late)))
