"""A plant's MuJoCo model as it is, or as a payload or friction makes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ....parameters import Array

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS  # time, positions, velocities, activations


@dataclass(frozen=True, eq=False)
class Variant:
    """One model of a plant, its data, and its actuators' gains before any fault of theirs.

    Attributes:
        model: MuJoCo's model.
        data: MuJoCo's data.
        gain_places: see `Plant`.
        gainprm: the model's actuator gains.
        userdata: the callback's parameters.
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
