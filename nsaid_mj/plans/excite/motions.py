"""Motions of a design as vectors of numbers: of an arm's joints, and of vehicles' controllers.

An arm's candidate is (n, 2h + 1): for every joint the weights of its sines and cosines, and the
centre of its motion in its range. The weights are divided by k, which favours low harmonics, and
scaled until the joint's position, speed or acceleration reaches its limit, so that every candidate
uses the limits fully. Torque has a penalty, and so have contacts, for which there is one more
number per joint: a factor on its amplitude.

A vehicle's has one number for every uniform draw of the scenario's driver: frequencies and phases
of set-points and of the dither on commands. tanh maps it to a share of the draw's range. The motion
is that of a simulation in closed loop under a draw of the prior, so box, speed and attitude are
those of the closed loop. Amplitudes are those of the driver, reduced to the limit of commands: a
multisine's reach that limit anyway, and larger dither only slowed the search.

In the last step of a design, a motion is simulated under every draw, and must keep its limits.
"""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from ...base import InvalidInput
from ...core import Array, JointTree, Log, SecondOrderSystem
from ...lab import (
    DesignedSignals,
    DesignedTracking,
    DriverConfig,
    FourierTracking,
    Series,
)
from .errors import NoMotion
from .experiment import Experiment
from .limits import COMMAND, Limits, coordinates_of, extents_of, settled

_STEP = 0.04  # longest step at which an arm's information is computed [s]
_SEARCHED = 10.0  # longest motion in the search [s]
_FINE = 24  # samples in the period of the highest harmonic, for peaks
_REPORTED = 0.01  # longest step at which the information of a simulated motion is computed [s]
_POSES = 60  # poses checked for contacts, and cost per share of them that touch
_TOUCHED = 30.0
_PENALTY = 3.0  # cost per unit of use beyond a limit


class JointMotions:
    """Candidates of an arm's motion, with harmonics and tracking loop of the excitation `base`.

    Attributes:
        step: at which the search computes information [s].
        stride: time steps between samples of a simulated motion at which it is computed.
        moving: (n,) whether a joint moves.

    Raises:
        InvalidInput: the system is not an arm on a fixed base, or some joints are passive.
    """

    parallel = True
    """Whether candidates may be judged in several threads."""

    def __init__(self, experiment: Experiment, limits: Limits, base: FourierTracking):
        system = experiment.system
        if not isinstance(system, JointTree) or system.group:
            kind = type(system).__name__
            remedy = "Design a vehicle's."
            raise InvalidInput("design", "an arm on a fixed base", kind, remedy)
        if system.n_u < system.n:
            got = f"{system.n_u} on {system.n} joints"
            remedy = "For passive joints use a random motion: `nsaid run arm --robot FILE`."
            raise InvalidInput("design", "a motor on every joint", got, remedy)
        self.experiment = experiment
        self.limits = limits
        self.base = base
        self._n = system.n
        self._harmonics = np.arange(1.0, base.harmonics + 1)
        self._omega = 2 * np.pi * base.fundamental * self._harmonics
        period = 1 / base.fundamental
        top = base.fundamental * base.harmonics
        self._fine = _basis(self._omega, np.arange(0, period, 1 / (_FINE * top)))
        self._t = np.zeros(0)
        self.take_step(min(_STEP, 1 / (12 * top)))
        self.contacts = experiment.contacts if limits.contacts else None
        if limits.contacts and self.contacts is None:
            remedy = "Leave contacts out, or add meshes."
            raise InvalidInput("limits.contacts", "a robot with meshes", "none", remedy)
        self._columns = 2 * len(self._omega) + (1 if self.contacts is None else 2)
        self.moving = np.isin(np.arange(1, self._n + 1), base.joints or np.arange(1, self._n + 1))

    def take_step(self, longest: float) -> None:
        """Sets the step at which the search computes information, at most `longest` [s]."""
        scenario = self.experiment.scenario
        period = 1 / self.base.fundamental
        self.step = scenario.dt * max(1, int(longest / scenario.dt + 1e-9))
        self.stride = max(1, round(min(self.step, _REPORTED) / scenario.dt))
        self._t = np.arange(0, min(scenario.duration, max(_SEARCHED, period)), self.step)
        self._coarse = _basis(self._omega, self._t)
        self._in_period = int(min(len(self._t), np.ceil(period / self.step)))

    @property
    def size(self) -> int:
        """Length of a candidate."""
        return self._n * self._columns

    def random(self, rng: np.random.Generator) -> Array:
        """A random candidate, centred in the joints' ranges."""
        numbers = rng.standard_normal((self._n, self._columns))
        if self.contacts is None:
            numbers[:, -1] = 0.0
        return numbers.ravel()

    def series(self, candidate: Array, share: Array | float = 1.0) -> Series:
        """The trajectory of a candidate, with every joint's swing and offset times a share (n,).

        With all shares 0 the arm rests in the middle of its range.
        """
        numbers = candidate.reshape(self._n, -1)
        smaller = share
        weights = numbers[:, : 2 * len(self._omega)] / np.tile(self._harmonics, 2)
        if self.contacts is not None:  # motions that nearly reach the limits would touch everything
            share = share / (1 + np.exp(2 - numbers[:, -2]))
        limits = self.limits.limits
        free = 1 - self.limits.margin
        place, speed, acceleration = (part @ weights.T for part in self._fine)
        low = limits["position"].low
        high = limits["position"].high
        half = 0.5 * (high - low)
        middle = 0.5 * (high + low)
        peak = np.abs(place).max(axis=0)
        reach = peak / half
        for name, part in (("speed", speed), ("acceleration", acceleration)):
            reach = np.maximum(reach, np.abs(part).max(axis=0) / limits[name].high)
        reach /= free
        scaled = (share / np.maximum(reach, 1e-12))[:, None] * weights
        scaled[~self.moving] = 0.0
        room = np.maximum(free * half - share * peak / np.maximum(reach, 1e-12), 0.0)
        centre = middle + smaller * room * np.tanh(numbers[:, -1])
        return Series(self._omega, scaled, np.where(self.moving, centre, middle))

    def motion(self, series: Series, draw: int) -> tuple[Log, Array]:
        """The motion at coarse steps with its torques (N, n) under a draw of the prior."""
        place, speed, acceleration = (part @ series.coefficients.T for part in self._coarse)
        system = self.experiment.system
        theta = self.experiment.draws[draw]
        q = system.position(place + series.centre)
        torque = system.torques(theta, q, speed, acceleration)
        return Log.unchecked(
            self._t, q, np.ascontiguousarray(speed), torque / theta[system.space.actuators]
        ), torque

    def candidate(self, candidate: Array, draw: int) -> tuple[Log, float]:
        """The motion of a candidate under a draw, and its penalty, 0 inside the limits."""
        log, torque = self.motion(self.series(candidate), draw)
        system = self.experiment.system
        top = (1 - self.limits.margin) * self.limits.limits["torque"].high
        excess = np.maximum(np.abs(torque).max(axis=0) / top - 1, 0.0)
        penalty = _PENALTY * float(excess.sum())
        if self.contacts is not None:
            poses = coordinates_of(system, self.period(log).q)
            poses = poses[:: max(1, len(poses) // _POSES)]
            penalty += _TOUCHED * float(np.mean([bool(w) for w in self.contacts.touching(poses)]))
        return log, penalty

    def period(self, log: Log) -> Log:
        """One period of a motion, after which a Gramian repeats."""
        return log.first(self._in_period)

    def driver(self, candidate: Array, share: Array | float = 1.0) -> DesignedTracking:
        """The driver of a candidate; `share` is that of `series`."""
        return DesignedTracking.of(self.series(candidate, share), self.base.bandwidth)


def _basis(omega: Array, t: Array) -> tuple[Array, Array, Array]:
    """(N, 2h) sines and cosines at times t, and their first and second derivatives."""
    s = np.sin(np.outer(t, omega))
    c = np.cos(np.outer(t, omega))
    return (
        np.hstack([s, c]),
        np.hstack([c * omega, -s * omega]),
        np.hstack([-s * omega**2, -c * omega**2]),
    )


_DRIVEN_STEP = 0.02  # that of a vehicle [s]
_AMPLITUDES = ("amplitude", "dither", "swing")  # fields of drivers: shares of a command's range


class DrivenMotions:
    """Candidates of a vehicle's motion: frequencies and phases of `base`, an excitation.

    Attributes:
        size: length of a candidate.
        stride: time steps between samples at which information is computed.

    Raises:
        InvalidInput: the driver has no uniform draws.
    """

    parallel = False
    """MuJoCo's callbacks, needed by the simulation, are global in a process."""

    def __init__(self, experiment: Experiment, limits: Limits, base: DriverConfig):
        largest = limits.limits[COMMAND].high.min() if COMMAND in limits.limits else np.inf
        base = amplified(base, 1.0, float(largest))
        self.experiment = experiment
        self.limits = limits
        self.base = base
        self.size = DesignedSignals.draws_of(base, experiment.system, experiment.prior)
        if not self.size:
            expected = "a driver with random frequencies or phases"
            raise InvalidInput("design", expected, type(base).__name__, "")
        self.stride = max(1, round(_DRIVEN_STEP / experiment.scenario.dt))

    def random(self, rng: np.random.Generator) -> Array:
        """A random candidate; its shares are uniform."""
        return np.arctanh(rng.uniform(-1, 1, self.size) * (1 - 1e-9))

    def candidate(self, candidate: Array, draw: int) -> tuple[Log, float]:
        """The motion of a candidate under a draw, and its penalty, 0 inside the limits."""
        experiment = self.experiment
        duration = experiment.scenario.duration
        log = experiment.simulate(self.driver(candidate), draw, duration)
        if log is None:
            return Log.unchecked(*(np.zeros((2, 1)),) * 4), np.inf
        uses = self.limits.uses(extents_of(experiment.system, log, experiment.draws[draw]))
        excess = sum(max(0.0, use - 1 + self.limits.margin_of(name)) for name, use in uses.items())
        return coarse(self.stride, log), _PENALTY * excess

    def period(self, log: Log) -> Log:
        """The motion itself; it has no period."""
        return log

    def driver(self, candidate: Array, share: float = 1.0) -> DesignedSignals:
        """The driver of a candidate, its amplitudes multiplied by `share`."""
        shares = np.clip(0.5 + 0.5 * np.tanh(candidate), 1e-12, 1.0)
        return DesignedSignals(amplified(self.base, share), tuple(shares.tolist()))


def coarse(every: int, log: Log) -> Log:
    """A simulated motion at the steps at which its information is computed."""
    return Log.unchecked(*(np.ascontiguousarray(part[::every]) for part in log))


def amplitudes_of(config: DriverConfig) -> list[str]:
    """Names of a driver's amplitudes of commands."""
    return [field.name for field in fields(config) if field.name in _AMPLITUDES]


def amplified(config: DriverConfig, factor: float, largest: float = np.inf) -> DriverConfig:
    """A driver with the amplitudes of its commands times a factor > 0; none exceeds the largest."""
    values = {name: getattr(config, name) for name in amplitudes_of(config)}
    return replace(config, **{name: min(factor * x, largest) for name, x in values.items()})


_SHRINK = 0.98  # further factor of a joint that breaks a limit
_ATTEMPTS = 12  # attempts to make an arm's motion smaller
_ALONE = 3  # of them that shrink only joints that break a limit; then all
_ALL = 0.6  # factor of every joint at each of the others
_SMALLER = 0.9  # amplitudes of a vehicle's commands at a second attempt

Motions = JointMotions | DrivenMotions
"""The candidates of a search."""


def checked(
    motions: Motions, candidates: Sequence[Array], limits: Limits
) -> tuple[DriverConfig, tuple[Log, ...], dict[str, float]]:
    """The driver of a candidate whose simulations under all draws keep all limits.

    The best candidate is tried first. An arm's motion is scaled down until it keeps the limits,
    first the joints that break one, then all, as the others' motion moves light joints; for a
    vehicle, the first candidate that keeps them is used, if necessary with smaller commands.

    Raises:
        NoMotion: every candidate breaks a limit.
    """
    least = {"stability": np.inf}
    entries = {}
    share = np.ones(motions.experiment.system.n)
    for attempt in range(_ATTEMPTS if isinstance(motions, JointMotions) else 2 * len(candidates)):
        if isinstance(motions, JointMotions):
            driver: DriverConfig = motions.driver(candidates[0], share)
        else:
            driver = motions.driver(candidates[attempt // 2], (1.0, _SMALLER)[attempt % 2])
        logs, worst = simulated(motions.experiment, driver, limits)
        if worst is None:
            share = 0.8 * share
            continue
        uses = {name: float(use.max()) for name, use in worst.items()}
        touching = touched(motions.experiment, limits, logs, motions.stride)
        if max(uses.values()) <= 1 and not touching:
            return driver, logs, uses
        if touching:
            uses["contacts"] = np.inf
            share = 0.9 * share
        if max(uses.values()) < max(least.values()):
            least = uses
            entries = worst
        if isinstance(motions, JointMotions):
            joint = np.max(list(worst.values()), axis=0)
            share = share * np.where(joint > 1, _SHRINK / np.minimum(joint, 1.5), 1.0)
            share = share * (1.0 if attempt < _ALONE else _ALL)
    name = max(least, key=lambda name: least[name])
    if not np.isfinite(least[name]):
        raise NoMotion(
            f"every motion that was checked breaks the limit of {name}",
            "Restrict the positions to a pose with more room around it, or give more --effort.",
        )
    raise NoMotion(*_binding(motions.experiment.system, limits, name, entries[name]))


def _binding(system: SecondOrderSystem, limits: Limits, name: str, use: Array) -> tuple[str, str]:
    """The active limit, and the remedy."""
    worst = int(np.argmax(use))
    limit = limits.limits[name]
    joints = getattr(system, "joint_names", ())
    where = f" of {joints[worst]}" if len(joints) == len(use) else ""
    source = limits.sources.get(name, "")
    more = use[worst] - 1
    excess = f"{100 * more:.0f} %" if more < 1 else f"a factor of {1 + more:.3g}"
    ends = f"{limit.low[worst]:.3g} … {limit.high[worst]:.3g} {limit.unit}"
    return (
        f"the smallest motion that was tried exceeds the limit of {name}{where}, {ends}"
        f"{f' (from {source})' if source else ''}, by {excess} in simulation",
        f"Widen the limit of {name} in a file for --limits"
        + (", or restrict the positions to where gravity requires less." if joints else "."),
    )


def touched(experiment: Experiment, limits: Limits, logs: Sequence[Log], every: int) -> bool:
    """Whether simulated motions make contacts that limits forbid, at every so many samples."""
    contacts = experiment.contacts if limits.contacts else None
    system = experiment.system
    poses = (coordinates_of(system, settled(system, log).q[::every]) for log in logs)
    return contacts is not None and any(any(contacts.touching(each)) for each in poses)


def simulated(
    experiment: Experiment, driver: DriverConfig, limits: Limits
) -> tuple[tuple[Log, ...], dict[str, Array] | None]:
    """The motions under all draws, and the largest use of every limit; None if one diverges."""
    logs = []
    uses = []
    for draw, theta in enumerate(experiment.draws):
        log = experiment.simulate(driver, draw, experiment.scenario.duration)
        if log is None:
            return tuple(logs), None
        logs.append(log)
        uses.append(limits.entries(extents_of(experiment.system, log, theta)))
    return tuple(logs), {name: np.max([own[name] for own in uses], axis=0) for name in uses[0]}
