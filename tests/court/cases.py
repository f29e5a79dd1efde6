"""What every run of the study is, drawn from a seed: robot, motion, sensors, prior, law, effect.

Runs come in threes that share all but the effect: the first has none, and tells what deviations the
law states where the structure holds; the others have one effect each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .effects import EFFECTS
from .motions import ARM_MOTIONS, VEHICLE_MOTIONS

LAWS = ("efficient", "memory", "identify")
TOGETHER = 3  # runs that share robot, motion and sensors
_SHARES = (0.6, 0.2, 0.2)  # of the laws
_VEHICLES = {
    "bluerov2": ("rov", 30.0),
    "crazyflie": ("quad", 16.0),
    "hummingbird": ("quad", 16.0),
    "f1tenth": ("car", 30.0),
    "bmw320i": ("car", 30.0),
    "remus100": ("torpedo", 40.0),
    "astrobee": ("space", 60.0),
}
"""Kind and duration of the vehicles [s]."""
_PACKED = ("ur5", "panda", "kinova", "xarm7", "z1", "double_pendulum")


@dataclass(frozen=True)
class Case:
    """A run of the study.

    Attributes:
        number: of the run, from 0.
        seed: of the study.
        law: `efficient`, `memory` or `identify`.
        robot: name of an arm or a vehicle; `tree of k` for a random tree.
        kind: `arm`, or of which kind the vehicle is.
        motion: one of `motions`.
        sensor: `encoder`, `noise`, or `stock`: the package's own levels.
        prior: `drawn` or `nominal`, as in a scenario.
        gain_error: as in a scenario; None for that of all parameters.
        duration: [s].
        dt: time step [s]; 0 for that of the vehicle's scenario.
        effect: name of the effect; `none`.
        size: of the effect.
    """

    number: int
    seed: int
    law: str
    robot: str
    kind: str
    motion: str
    sensor: str
    prior: str
    gain_error: float | None
    duration: float
    dt: float
    effect: str
    size: float

    @property
    def group(self) -> int:
        """Number of the group of runs that share all but the effect."""
        return self.number // TOGETHER

    def stream(self, *which: int) -> np.random.Generator:
        """A random stream of the group."""
        return np.random.default_rng([self.seed, self.group, *which])

    @property
    def words(self) -> str:
        """Such as `17 efficient ur5 chirp encoder drawn, lag 5 time steps`."""
        effect = "exact"
        if self.effect != "none":
            effect = f"{self.effect} {self.size:g} {EFFECTS[self.effect].unit}"
        who = f"{self.number} {self.law} {self.robot}"
        return f"{who}, {self.motion}, {self.sensor}, {self.prior}: {effect}"


def drawn(seed: int, number: int, laws: Sequence[str] = LAWS) -> Case:
    """The run of a number of the study of a seed, among some of the laws."""
    group, member = divmod(number, TOGETHER)
    rng = np.random.default_rng([seed, group])
    shares = np.array([_SHARES[LAWS.index(law)] for law in laws])
    law = str(rng.choice(list(laws), p=shares / shares.sum()))
    robot, kind, duration = _robot(rng, law)
    motions = ARM_MOTIONS
    if kind != "arm":
        motions = VEHICLE_MOTIONS if kind == "rov" else VEHICLE_MOTIONS[:1]
    motion = str(rng.choice(motions))
    sensor = str(rng.choice(["stock", "noise", "encoder"], p=[0.4, 0.2, 0.4]))
    dt = float(rng.choice([1e-3, 2e-3])) if kind == "arm" else 0.0
    if sensor == "encoder" and kind != "arm":
        sensor = "noise"
    prior = str(rng.choice(["drawn", "nominal"]))
    gain_error = 0.3 if rng.random() < 0.25 else None
    effect, size = "none", 0.0
    if member:
        known = [name for name, effect in EFFECTS.items() if kind in effect.robots]
        if law == "identify":
            known = [name for name in known if name not in ("loss", "payload", "noise")]
        effect = str(rng.permutation(known)[member - 1])
        size = float(rng.permuted(np.tile(EFFECTS[effect].sizes, (member, 1)), axis=1)[-1, 0])
    shared = robot, kind, motion, sensor, prior, gain_error, duration, dt
    return Case(number, seed, law, *shared, effect, size)


def _robot(rng: np.random.Generator, law: str) -> tuple[str, str, float]:
    """Name, kind and duration of the run [s]."""
    chance, offline = rng.random(), law == "identify"
    duration = 30.0 if offline else float(rng.choice([10.0, 15.0, 20.0]))
    joints, arm = int(rng.integers(2, 10)), str(rng.choice(_PACKED))
    vehicle = str(rng.choice(list(_VEHICLES)))
    if chance < 0.45:
        return f"tree of {joints}", "arm", duration
    if chance < (0.9 if offline else 0.7):
        return arm, "arm", duration
    vehicle = "bluerov2" if offline else vehicle
    return vehicle, *_VEHICLES[vehicle]
