"""Arms whose commands act late and whose friction falls with speed, logged at 125 Hz.

`draw` makes a log by inverse dynamics from a seed, with the truth of all that `identify` prints;
`judge` compares. Nothing here is tuned on a seed: robot, delay, friction, motion and noise are
drawn.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.result import Identification
from nsaid_mj.core import JointTree
from nsaid_mj.robots.assets import asset, packed_robots
from tests.court.robots import with_wrong_masses
from tests.support.robot_logs import write_csv

RATE = 125.0  # of the logs [Hz]
LATEST = 0.02  # delay [s]
_MASSES = 0.2  # largest relative error of the model file's masses
_ABSENT = ("load", "quadratic", "cubic", "stiffness", "offset")


@dataclass(frozen=True)
class Draw:
    """A log and its truth.

    Attributes:
        robot: its name.
        urdf: text of a model file whose masses are off.
        table: columns of the log.
        delay: of all commands [s].
        truth: values of parameters by name; 0 of columns that the robot has not.
    """

    robot: str
    urdf: str
    table: dict[str, np.ndarray]
    delay: float
    truth: dict[str, float]

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Writes model and log."""
        model = folder / "model.urdf"
        model.write_text(self.urdf, encoding="utf-8")
        return model, write_csv(folder / "log.csv", self.table)


@dataclass(frozen=True)
class Judged:
    """What a log was identified as.

    Attributes:
        delays: (k,) printed [s].
        error: of the commonest printed delay [s].
        covered: whether its interval holds the truth; None if none is printed.
        numbers: by identified parameter, whether its interval holds the truth.
        held_out: mean logarithm over the joints of the held-out errors.
    """

    delays: np.ndarray
    error: float
    covered: bool | None
    numbers: dict[str, bool]
    held_out: float


def draw(seed: int, frequency: float = RATE) -> Draw:
    """A log by inverse dynamics at a rate [Hz], with friction and rotors that are substantial."""
    rng = np.random.default_rng([seed, 125])
    name = str(rng.choice(["ur5", "tx40"]))
    robot = load_robot_model(name)
    n = len(robot.joints)
    delay = float(rng.uniform(0.0, LATEST))
    duration = float(rng.uniform(20.0, 40.0))
    fastest = float(10 ** rng.uniform(-0.4, 0.3))
    rates = 2 * np.pi * rng.uniform(0.1, fastest, (6, n))
    phases = rng.uniform(0, 6.28, (6, n))
    size = rng.uniform(0.3, 1.0, (6, n)) / rates
    size *= rng.uniform(0.7, 1.5) / np.sqrt(np.sum((size * rates) ** 2, axis=0))
    model = pin.Model(robot.model)
    data = model.createData()
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    bounded = model.nq == n and np.isfinite([low, high]).all()
    middle = 0.5 * (low + high) if bounded else np.zeros(n)
    size *= np.minimum(1.0, 0.45 * (high - low) / np.sum(size, axis=0)) if bounded else 1.0

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = t[:, None, None] * rates + phases
        q = middle + np.sum(size * np.sin(angle), axis=1)
        v = np.sum(size * rates * np.cos(angle), axis=1)
        return q, v, -np.sum(size * rates**2 * np.sin(angle), axis=1)

    def inertial(t: np.ndarray) -> np.ndarray:
        q, v, a = motion(t)
        rows = zip(JointTree.links(model).position(q), v, a, strict=True)
        return np.array([pin.rnea(model, data, *row) for row in rows])

    t = np.arange(round(duration * frequency)) / frequency
    typical = np.sqrt(np.mean(inertial(t[::20]) ** 2, axis=0))
    typical = np.maximum(typical, 0.05 * typical.max())
    friction = 10 ** rng.uniform(-0.3, 0.3, (3, n))
    level = 10 ** rng.uniform(-1.0, -0.1)  # of dry friction over the other forces
    viscous, coulomb, rotor = friction * np.array([[0.15], [level], [0.02]]) * typical
    stribeck = coulomb * rng.uniform(0.0, 1.0, n) * (rng.random() < 0.8)
    falls = 10 ** rng.uniform(-1.3, -0.7, n)  # speeds at which it has fallen to 1/e [rad/s]
    s = np.minimum(10 ** rng.uniform(-2.2, -1.2, n), 0.4 * falls)

    def force(t: np.ndarray) -> np.ndarray:
        _, v, a = motion(t)
        dry = (coulomb + stribeck * np.exp(-((v / falls) ** 2))) * np.tanh(v / s)
        return inertial(t) + rotor * a + viscous * v + dry

    gain = rng.uniform(0.7, 1.3, n) * typical / 5.0
    u = force(t + delay) / gain
    u += rng.uniform(0.002, 0.01) * 5.0 * rng.standard_normal(u.shape)
    q = motion(t)[0] + 10 ** rng.uniform(-5.0, -4.0) * rng.standard_normal(u.shape)
    table = {"time": t}
    for j, joint in enumerate(robot.joints):
        table |= {f"{joint}_position": q[:, j], f"{joint}_current": u[:, j]}
    parts = {"gain": gain, "rotor": rotor, "viscous": viscous}
    parts |= {"coulomb": coulomb, "stribeck": stribeck}
    parts |= {name: np.zeros(n) for name in _ABSENT}
    truth = {f"{k}_{j + 1}": float(x[j]) for k, x in parts.items() for j in range(n)}
    file = packed_robots().get(name, asset(name, f"{name}.urdf"))
    urdf = with_wrong_masses(file.read_text("utf-8"), rng, _MASSES)
    return Draw(name, urdf, table, delay, truth)


def identified(
    drawn: Draw, delay: float | None = None, cutoff: float | None = None
) -> Identification:
    """The result of a log, with one gain told; at a known delay [s] and cut-off [Hz] if given."""
    known = {"gain_1": drawn.truth["gain_1"]}
    with tempfile.TemporaryDirectory() as folder:
        model, log = drawn.write(Path(folder))
        return identify_forces(str(model), log, known=known, delay=delay, cutoff=cutoff)


def judge(found: Identification, drawn: Draw) -> Judged:
    """Compares a result with the truth."""
    delays = np.array([joint.delay for joint in found.joints])
    common = float(np.median(delays))
    covered = None
    for joint in found.joints:
        interval = getattr(joint, "delay_interval", None)
        if interval is not None and joint.delay == common:
            covered = bool(interval[0] <= drawn.delay <= interval[1])
    numbers = {}
    for p in found.parameters:
        if p.status == "identified" and p.name in drawn.truth:
            numbers[p.name] = bool(p.low <= drawn.truth[p.name] <= p.high)
    errors = np.log([joint.held_out for joint in found.joints])
    return Judged(delays, common - drawn.delay, covered, numbers, float(errors.mean()))
