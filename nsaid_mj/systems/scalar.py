"""The 1-DOF vehicle of the paper, (16)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..dynamics.forward import Body, force_law, forces_along
from ..dynamics.motions import BodyMotion, force_regressors
from ..dynamics.structures import ConstantInertia
from ..log import Log, Middle
from ..numerics.interpolation import body_midpoints
from ..numerics.linalg import evaluate
from ..parameters import Array, Block, ParameterSpace
from ..system import SecondOrderSystem, Stage


class ScalarForces(NamedTuple):
    """Drag, weight and thruster, for compiled loops.

    Attributes:
        n: number of velocities, 1.
    """

    n: int


@force_law(ScalarForces)
@njit(cache=True)
def _forces(forces, q, v, u, F):
    F[0, 1], F[0, 2], F[0, 3] = -v[0] * abs(v[0]), -1.0, u[0]


class ScalarVehicle(SecondOrderSystem):
    """m v̇ = −d v|v| − g + a u (16), θ = [m, d, g, a].

    x = (height z [m], upward velocity v [m/s]); u is the thruster command in [−1, 1]; g is the
    weight minus buoyancy [N]. M does not depend on x, so C = 0. Normalising by m gives the reduced
    form (17): hold `mass` at 1 with `ConventionalAID(known=("mass",))`.

    Args:
        scale: (4,) guess of m [kg], d [N·s²/m²], g [N], a [N].
        speed: speed of operation [m/s], for random probes of the structure.
    """

    n, m, n_u = 1, 1, 1
    velocity_units = ("m/s",)
    inertia = ConstantInertia(np.zeros((1, 3), dtype=np.intp), np.ones(1))
    forward = Body(inertia, 0, ScalarForces(1))
    mounts = np.zeros((1, 3))  # point of application of the thrust, for drawing [m]

    def __init__(self, scale: Array, speed: float = 1.0):
        m, d, g, a = np.asarray(scale, dtype=np.float64)[:, None]
        self.speed = speed
        self.space = ParameterSpace(
            (
                Block("mass", ("mass",), ("kg",), m, "positive"),
                Block("drag", ("drag",), ("N·s²/m²",), d, "positive"),
                Block("net weight", ("net weight",), ("N",), g),
                Block("thruster gain", ("thruster gain",), ("N",), a, "positive", actuator=True),
            )
        )

    def _W_M(self, q: Array, a: Array) -> Array:
        return np.array([[a[0], 0.0, 0.0, 0.0]])

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        return np.zeros((1, 4))

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        return self.forces(np.array([t]), q[None], v[None], u[None])[0]

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._W_M(q, a) - self._F(t, q, v, u)

    def _mass_tensor(self, q: Array) -> Array:
        return self._W_M(q, np.ones(1))[None]

    def _transport(self, q: Array, v: Array) -> Array:
        return np.zeros((1, 4))

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """The acceleration (29), the regressor (10, 31) and M̂'s smallest pivot at one sample."""
        W_C, F = self._W_C(q, v, w), self._F(t, q, v, u)
        return Stage(*evaluate(self._mass_tensor(q), W_C, F, theta))

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples."""
        return Middle(*body_midpoints(0, log.t, log.q, log.v, hermite))

    def motion(self, log: Log, hermite: bool) -> BodyMotion:
        """The vehicle's motion along a log."""
        middle = self.midpoints(log, hermite)
        F = force_regressors(self, log, middle)
        return BodyMotion(self.inertia, 0, log.t, log.v, middle.v, F)

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, 1, 4) F for N samples."""
        return forces_along(self.forward.forces, q, v, u, 4)

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance, where C = 0."""
        t, held = log.t, log.u[:-1]
        momenta, half = np.zeros((len(t), 1, 4)), np.zeros((len(v), 1, 4))
        momenta[:, 0, :1], half[:, 0, :1] = log.v, leak * v
        start = leak * momenta[:-1] + self.forces(t[:-1], log.q[:-1], log.v[:-1], held)
        end = leak * momenta[1:] + self.forces(t[1:], log.q[1:], log.v[1:], held)
        return momenta, start, half + self.forces(0.5 * (t[:-1] + t[1:]), q, v, held), end

    def integrate(self, q: Array, dq: Array) -> Array:
        """q + dq: the position is a number."""
        return q + dq

    def difference(self, q0: Array, q1: Array) -> Array:
        """q1 − q0: the position is a number."""
        return q1 - q0

    def J(self, q: Array) -> Array:
        """(1, 1) identity: q̇ = v (3)."""
        return np.eye(1)

    def position(self, coordinates: Array) -> Array:
        """(..., 1) a copy of the position coordinates, which are the position."""
        return np.array(coordinates, dtype=np.float64)

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws height within 10 m, velocity within twice the speed, command within its range."""
        return rng.uniform(-10, 10, 1), self.speed * rng.uniform(-2, 2, 1), rng.uniform(-1, 1, 1)
