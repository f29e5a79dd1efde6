"""The interface of a driver: the initial state, and the command at every sample.

Computed torque along a Fourier series, the law of `FourierTracking`, is compiled.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import f8, i8, types, void

from ..bounds import Config, config
from ..errors import InvalidInput
from ..numerics.kernels import kernel
from ..parameters import Array, Indices
from ..structure.inverse_dynamics import (
    INVERSE_DYNAMICS,
    InverseDynamics,
    position_error,
    write_required_force,
)
from ..structure.joints import JointTree
from ..structure.system import SecondOrderSystem
from .signals import SERIES, Series, fourier


class Tracking(NamedTuple):
    """Parameters of a computed-torque controller for an arm on a fixed base."""

    arm: InverseDynamics  # the arm's structure
    driven: Indices  # (d,) numbers of the joints that have a motor
    theta: Array  # (p,) the controller's model θ̂₀; the gains of the motors come last
    series: Series  # the reference trajectory of the joints
    omega: float  # bandwidth of the tracking loop [rad/s]
    limit: Array  # (d,) largest commands, > 0


class TrackingMemory(NamedTuple):
    """Workspace of `computed_torque`."""

    desired: Array  # (n, 3) position, velocity and acceleration
    a: Array  # (n,) requested acceleration, 0 of passive joints
    force: Array  # (n,) that it requires


def tracking_workspace(tracking: Tracking) -> TrackingMemory:
    """Allocates the workspace of `computed_torque`."""
    n = len(tracking.series.centre)
    return TrackingMemory(desired=np.empty((n, 3)), a=np.zeros(n), force=np.empty(n))


TRACKING = types.NamedTuple((INVERSE_DYNAMICS, i8[::1], f8[::1], SERIES, f8, f8[::1]), Tracking)
TRACKING_MEMORY = types.NamedTuple((f8[:, ::1], f8[::1], f8[::1]), TrackingMemory)


@kernel(void(TRACKING, f8, f8[::1], f8[::1], TRACKING_MEMORY, f8[::1]))
def computed_torque(tracking, t, q, v, workspace, u):
    """Writes u = K̂⁻¹ [M̂ a + Ĉ v − F̂(u = 0)] with a = a_d + 2ω ė + ω² e into u (d,).

    Passive joints swing freely: a is 0 for them, and their actual acceleration is a disturbance of
    the loop. The command is limited like a motor's: a model far from the truth can make the sampled
    loop unstable, whose motion then stays bounded. q (m,) and v (n,) are measured.
    """
    arm, driven, theta, series, omega, limit = tracking
    desired, a, force = workspace
    gain = theta.shape[0] - driven.shape[0]
    fourier(series, t, desired)
    for i in driven:
        error = position_error(arm.structure, i, q, desired[i, 0])
        a[i] = desired[i, 2] + 2 * omega * (desired[i, 1] - v[i]) + omega**2 * error
    write_required_force(arm, q, v, a, theta, force)
    for k in range(driven.shape[0]):
        u[k] = min(max(force[driven[k]] / theta[gain + k], -limit[k]), limit[k])


class Driver(ABC):
    """A controller: computes the command from time and measured state."""

    @abstractmethod
    def start(self) -> tuple[Array, Array]:
        """Resets the controller; (n,) position numbers and (n,) velocities of the initial state."""

    @abstractmethod
    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) command that is held from t [s] until the next sample; q (m,), v (n,) measured."""


@dataclass(eq=False)
class Feedback(Driver):
    """A driver without memory, made of two functions."""

    begin: Callable[[], tuple[Array, Array]]  # what `start` returns
    law: Callable[[float, Array, Array], Array]  # `command`

    def start(self) -> tuple[Array, Array]:
        """The initial state."""
        return self.begin()

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) command."""
        return self.law(t, q, v)


class CompiledDriver(Driver):
    """A driver whose law compiled code may evaluate."""

    @abstractmethod
    def compiled(self, t: Array) -> Array | Tracking | None:
        """The control law in a form that compiled code evaluates, bit for bit as `command` does.

        It is the commands (k, n_u) at times t (k,) [s], if the driver is open loop; the parameters
        of `computed_torque`, if that is its law; None if only `command` can evaluate it.
        """


class InformedDriver(Driver):
    """A driver that can use an identifier's estimate while it drives."""

    period: float  # interval at which it is informed [s]; infinite if it never is

    @abstractmethod
    def inform(self, theta_hat: Array) -> None:
        """Receives the estimate θ̂ (p,) of the run's identifier, every `period`."""


@config
class DriverConfig(Config, ABC):
    """A driver's parameters, as part of a scenario; `build` makes the driver."""

    _path = "excitation"

    @abstractmethod
    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver of a structure, whose controller uses the prior θ̂(0) (p,) as its model.

        Frequencies, phases and coefficients come from `rng`.
        """


def tree(system: SecondOrderSystem, wanted: str, remedy: str, carried_by: str = "") -> JointTree:
    """The system, if it is an arm on a fixed base, or one carried by a vehicle with such columns.

    `wanted` and `remedy` are for the message.

    Raises:
        InvalidInput: it is not.
    """
    suits = system.columns(carried_by) if carried_by else not system.group
    if not isinstance(system, JointTree) or not suits:
        raise InvalidInput("excitation", wanted, type(system).__name__, remedy)
    return system
