"""The effects of a sequence of faults over time, for plant, MuJoCo model and truth alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .....core import Array, SecondOrderSystem
from .kinds import ActuatorFault, Bias, Broken, Fault, PlantFault, Stuck

_NOTCH = 0.02  # share of a gain, lost slowly, from which evaluation counts the truth as another


class Schedule:
    """Faults on the grid of time steps; each strikes between two steps, the nearest to its time.

    Raises:
        InvalidInput: the system lacks a part that a fault names.
    """

    def __init__(self, faults: Sequence[Fault], system: SecondOrderSystem, dt: float):
        self._faults = tuple(faults)
        self._system = system
        self._gains = [fault.affected(system) for fault in faults]

        def between(time: float | None) -> float:
            return np.inf if time is None else (round(time / dt) - 0.5) * dt

        self._begin = np.array([between(fault.time) for fault in faults])
        self._end = np.array([between(fault.until) for fault in faults])
        times = np.concatenate([self._begin, self._end])
        # sorted times at which a fault begins or ends [s]
        self.edges: Array = np.unique(times[np.isfinite(times)])
        self._notches = np.unique(
            np.concatenate([self.edges, *map(self._slow_edges, range(len(faults)))])
        )

    def _slow_edges(self, i: int) -> Array:
        """Times at which a slow loss has taken another share `_NOTCH` [s]."""
        fault = self._faults[i]
        if not isinstance(fault, ActuatorFault) or fault.rate is None:
            return np.zeros(0)
        lost = np.append(np.arange(_NOTCH, fault.share, _NOTCH), fault.share)
        times = self._begin[i] + lost / fault.rate
        return times[times < self._end[i]]

    def epoch(self, t: ArrayLike) -> NDArray[np.intp]:
        """(...) number of earlier changes of the truth at times t (...) [s], 0 before a fault.

        A slow loss counts as one change per two per cent of the gain.
        """
        return np.searchsorted(self._notches, np.asarray(t), side="left")

    def next_edge(self, t: float) -> float:
        """The next time after t at which a fault begins or ends [s]; infinity if there is none."""
        later = self.edges[self.edges >= t]
        return float(later[0]) if len(later) else np.inf

    def _active(self, t: float) -> list[int]:
        return [int(i) for i in np.flatnonzero((t > self._begin) & ~(t > self._end))]

    def fades(self, t: float) -> bool:
        """Whether a gain is falling at time t [s]."""
        gains = [(i, f) for i in self._active(t) if isinstance(f := self._faults[i], ActuatorFault)]
        return any(f.rate and f.rate * (t - self._begin[i]) < f.share for i, f in gains)

    def factors(self, t: float) -> Array:
        """(n_u,) factors of every actuator's gains in the plant at time t [s]."""
        factors = np.ones(self._system.n_u)
        for i in self._active(t):
            if isinstance(fault := self._faults[i], ActuatorFault):
                factors[fault.actuator - 1] *= fault.factor(t - self._begin[i])
        return factors

    def stuck(self, t: float) -> list[tuple[int, float | None]]:
        """Actuators (from 0) that ignore their command, with the one they hold; None: the last."""
        found = [self._faults[i] for i in self._active(t)]
        stuck = [(f.actuator - 1, f.holding) for f in found if isinstance(f, Stuck)]
        return stuck + [(f.actuator - 1, 0.0) for f in found if isinstance(f, Broken)]

    def biases(self, t: float) -> Array | None:
        """(2, n) biases of positions and velocities at time t [s]; None if none."""
        n = self._system.n
        found = [f.biases(n) for i in self._active(t) if isinstance(f := self._faults[i], Bias)]
        return np.sum(found, axis=0) if found else None

    def carried(self, t: float) -> tuple[int, ...]:
        """Numbers of the faults of the plant itself, such as a payload, at time t [s]."""
        return tuple(i for i in self._active(t) if isinstance(self._faults[i], PlantFault))

    def all_carried(self) -> set[tuple[int, ...]]:
        """Every combination of faults of the plant itself that occurs."""
        return {self.carried(np.nextafter(edge, np.inf)) for edge in self.edges}

    def added(self, which: tuple[int, ...]) -> Array:
        """(p,) change of θ by faults of the plant itself, given by their numbers."""
        total = np.zeros(self._system.p)
        for i in which:
            fault = self._faults[i]
            assert isinstance(fault, PlantFault)
            total += fault.added(self._system)
        return total

    def theta(self, sound: Array, t: ArrayLike) -> Array:
        """(..., p) the true θ at times t (...) [s], from that of the sound plant (p,)."""
        times = np.asarray(t, dtype=np.float64)
        theta = np.broadcast_to(sound, (*times.shape, len(sound))).copy()
        active = [(times > a) & ~(times > b) for a, b in zip(self._begin, self._end, strict=True)]
        for here, fault in zip(active, self._faults, strict=True):
            if isinstance(fault, PlantFault):
                theta[here] += fault.added(self._system)
        for i, fault in enumerate(self._faults):
            if isinstance(fault, ActuatorFault) and active[i].any():
                since = times[active[i]] - self._begin[i]
                left = [0.0 if isinstance(fault, Stuck) else fault.factor(s) for s in since.flat]
                rows = theta[active[i]]
                rows[:, self._gains[i]] *= np.array(left)[:, None]
                theta[active[i]] = rows
        return theta


_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS  # time, positions, velocities, activations


@dataclass(frozen=True, eq=False)
class Variant:
    """One model of a plant, its data, and its actuators' gains before their faults.

    `gain_places` are those of `Plant`; `userdata` are the callback's parameters.
    """

    model: Any
    data: Any
    gain_places: Sequence[Sequence[int]]
    gainprm: Array
    userdata: Array

    @staticmethod
    def of(model: Any, data: Any, gain_places: Sequence[Sequence[int]]) -> Variant:
        """A plant's model and data as they are now."""
        gains = model.actuator_gainprm.copy()
        return Variant(model, data, gain_places, gains, data.userdata.copy())

    def enter(self, other: Variant) -> None:
        """Continues from the state of another variant of the same plant."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(other.model, other.data, state, _STATE)
        mujoco.mj_setState(self.model, self.data, state, _STATE)
        self.data.userdata[:] = self.userdata
        self.data.ctrl[:] = other.data.ctrl
        self.data.warning.number[:] = other.data.warning.number
        self.model.opt.timestep = other.model.opt.timestep

    def scale_gains(self, factors: Array) -> None:
        """Multiplies every actuator's gains by its factor (n_u,), in mjModel or in userdata."""
        self.model.actuator_gainprm[: len(factors)] = (
            self.gainprm[: len(factors)] * factors[:, None]
        )
        for places, factor in zip(self.gain_places, factors, strict=False):
            self.data.userdata[list(places)] = self.userdata[list(places)] * factor
