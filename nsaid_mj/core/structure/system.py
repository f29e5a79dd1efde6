"""The paper's class of systems, W(t, x, v, v̇) θ = 0, with the kinematics of a `Structure`.

A `SecondOrderSystem` is structure only: it defines the regressors' columns and holds no parameter
values. Its range of operation is abstract; the regressors, by the structure's kernels, and what
follows from them (the paper's W_M, W_C, F, the mass matrix (8), the acceleration (29)) are final,
as are the kinematics.

Symbols: q (m,) position, v (n,) measured velocity, x = (q, v) (m+n,) the combined state (3),
w (n,) the velocity that C multiplies (the identifier's v̂ or the measured v), a (n,)
acceleration, u command, θ (p,) parameters. F is always evaluated at the measured x.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from ...base import InvalidInput
from ..log import Log, Measurement
from ..numerics.low_pass import zero_phase
from ..numerics.spatial import continuous_signs
from ..parameters import Array, Indices, ParameterSpace, finite
from .arrays import StructureArrays
from .configuration_space import plain
from .contacts import contact_jacobians, eliminated_balance, without_contact_forces
from .information import acceleration_rows, information_along, torques_along
from .motion import Motion, accelerate_at, along, balance, write_motion
from .parts import ContactPoint
from .payload import PointMasses
from .regressor import write_regressors
from .sensing import SensedKinematics
from .structure import Structure

_TOGETHER = 64  # samples whose mass matrices are computed together


class Stage(NamedTuple):
    """A system at one measured state and command, under an estimate θ̂."""

    a: Array  # (n,) acceleration v̇(t, x, w, θ̂) of (29); NaN where M̂ is not positive definite
    W: Array  # (n, p) regressor W(t, x, w, θ̂) of (10, 31)
    pivot: float  # smallest pivot of M̂'s factorisation, > 0 where M̂ is positive definite


class SecondOrderSystem(SensedKinematics, ABC):
    """M(x, θ) v̇ + C(x, θ) v = F(t, x, u) θ (4), linear in θ (8, 9), with Ṁ − 2C skew.

    Args:
        structure: the robot, whose kinematics are the system's.
        space: names, units and scale of θ.
        mounts: (k, 3) point of application of every actuator parameter's force, in the body's
            axes [m], NaN if it exerts no force; None if there is nothing to draw.

    Attributes:
        n: number of velocities.
        m: number of positions.
        n_u: number of commands.
        reference: the source of the links' regressors, a `PinocchioLinks`; None where all
            are the structure's.
    """

    reference: Any = None

    def __init__(self, structure: Structure, space: ParameterSpace, mounts: Array | None = None):
        super().__init__(structure)
        self.space = space
        self.mounts = mounts

    @abstractmethod
    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a state and command (q, v, u) from the range of operation, to probe structure."""

    @cached_property
    def point_masses(self) -> PointMasses:
        """What point masses that are fixed to a body change in θ."""
        return PointMasses(self.space)

    @property
    def forward(self) -> StructureArrays | None:
        """The structure, for compiled simulation; None where the regressors are not its own."""
        return self.structure.arrays if self.reference is None else None

    def rebuilt(self, structure: Structure, space: ParameterSpace | None = None) -> Self:
        """A copy with another structure of the same joints, and with its parameters.

        Without `space` the parameters are this system's.
        """
        made = copy(self)
        vars(made).pop("p", None)  # they are cached, and another structure has others
        vars(made).pop("gains_by_command", None)
        vars(made).pop("point_masses", None)
        SecondOrderSystem.__init__(made, structure, space or self.space, self.mounts)
        return made

    @cached_property
    def gains_by_command(self) -> list[Indices]:
        """For each command, the indices of its gains: the actuator parameters whose force it moves.

        They are found by changing one command at a time at a random state in the range of
        operation.
        """
        rng = np.random.default_rng(0)
        found = []
        q, v, u = self.random_state(rng)
        others = self.random_state(rng)[2]
        x = np.concatenate([q, v])
        for k in range(self.n_u):
            other = u.copy()
            other[k] = others[k]
            moved = (self.F(0.0, x, u) != self.F(0.0, x, other)).any(axis=0)
            found.append(self.space.actuators[moved[self.space.actuators]])
        return found

    # -- along a log -----------------------------------------------------------------------------

    def motion(self, log: Log, hermite: bool) -> Motion:
        """The log's `Motion`; arguments are those of `midpoints`."""
        t, q, v, u = map(plain, log)
        qm = np.empty((len(t) - 1, self.m))
        vm = np.empty((len(t) - 1, self.n))
        found = self._states(len(t))
        arrays = self.structure.arrays
        write_motion(arrays, hermite, t, q, v, u, self._memory.work, qm, vm, *found)
        own = Motion(arrays, t, v, vm, *found)
        return own if self.reference is None else self.reference.motion(own, log.q, qm)

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance along a log of N samples; unchecked.

        Args:
            leak: rate a of the filter [1/s]; see `laws.memory.momentum`.
            log: the samples.
            q: (N−1, m) positions half-way between samples.
            v: (N−1, n) velocities half-way between samples.

        Returns:
            (N, n, p) W_M(q, v) at the samples; and three arrays (N−1, n, p), a W_M(q, v) + F + the
            regressor of Cᵀ v at start, middle and end of every step, with the command held. Of a
            structure with contacts, all without their forces; see `contacts`.
        """
        momenta, *drives = self._momentum_balance(leak, log, q, v)
        if not self.structure.contacts:
            return momenta, drives[0], drives[1], drives[2]
        still = np.zeros_like(v)
        middle = self._moving(q, still, still, v)
        return eliminated_balance(
            self.structure,
            (log.q, q),
            (log.v, v),
            (momenta, middle),
            (drives[0], drives[1], drives[2]),
        )

    def momentum(self, q: Array, v: Array) -> Array:
        """(n, p) W_M(q, v) of one sample; of a structure with contacts, without their forces."""
        momentum = self._W_M(q, v)
        if not self.structure.contacts:
            return momentum
        return without_contact_forces(self.structure, q[None], momentum[None])[0]

    def _momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """`momentum_balance` with all forces."""
        if self.reference is not None:
            return self.reference.momentum_balance(leak, log, q, v)
        own = plain(log.v)
        vm = plain(v)
        size = (self.n, self.p)
        momenta = np.empty((len(own), *size))
        spare = np.empty((2, *size))
        terms = np.empty((3, len(vm), *size))
        work = self._memory.work
        arrays = self.structure.arrays
        states = self._states(len(own))
        along(arrays, plain(log.q), own, plain(q), vm, plain(log.u), work, *states)
        balance(arrays, leak, own, vm, *states, work, *spare, momenta, *terms)
        return momenta, terms[0], terms[1], terms[2]

    def _states(self, count: int) -> tuple[Array, Array, Array]:
        """Room for states at `count` samples and half-way between, and for F; see `along`."""
        size = len(self._memory.state)
        states = np.empty((count, size))
        middles = np.empty((count - 1, size))
        return states, middles, np.empty((3, count - 1, len(self.structure.arrays.nonzeros)))

    def contact_jacobians(self, contacts: Sequence[ContactPoint], q: Array) -> tuple[Array, Array]:
        """(N, c, n) J and (N, k, 3) the places of k contacts at positions q (N, m).

        Both are in the common frame: of a floating base its own at each sample, else the world's.
        Rows follow one another contact by contact, forces [linear, then angular if flat].
        """
        return contact_jacobians(self.structure, contacts, q)

    def torques(self, theta: Array, q: Array, v: Array, a: Array) -> Array:
        """(N, n) forces of a motion q (N, m), v (N, n), a (N, n) under θ (p,), without commands."""
        found = np.empty(v.shape)
        motion = map(plain, (q, v, a))
        torques_along(self.structure.arrays, *self.structure.memory(), theta, *motion, found)
        return found

    def smoothed(self, log: Log, cutoff: float) -> Log:
        """The log with q and v passed through a zero-phase Butterworth filter; u is unchanged.

        Positions on a manifold are filtered component by component; each measured position is then
        moved along its tangent space towards the filtered value, so that it remains on the
        manifold. The log has a constant rate; the cut-off [Hz] is limited to 0.8 of the Nyquist
        frequency.
        """
        rate = 1 / log.step
        cutoff = min(cutoff, 0.4 * rate)
        q = log.q
        if self.group == 6:
            q = q.copy()
            q[:, 3:7] *= continuous_signs(q[:, 3:7])[:, None]
        filtered = zero_phase(q, cutoff, rate)
        if self.m != self.n:
            J = np.array([self.J(z) for z in q])
            along = np.einsum("kmn,km->kn", J, filtered - q)
            metric = np.einsum("kmi,kmj->kij", J, J)
            steps = np.linalg.solve(metric, along[..., None])[..., 0]
            pairs = zip(q, steps, strict=True)
            filtered = np.array([self.integrate(place, step) for place, step in pairs])
        return log._replace(q=filtered, v=zero_phase(log.v, cutoff, rate))

    def acceleration_rows(self, log: Log, theta: Array) -> Array | None:
        """(N, n, p) −M⁻¹ W diag(scale) along a log at θ (p,); None where M is not ≻ 0."""
        rows = np.empty((len(log.t), self.n, self.p))
        own = (self.structure.arrays, *self.structure.memory())
        scale = np.array(self.space.scale)
        return rows if acceleration_rows(*own, log.q, log.v, log.u, theta, scale, rows) else None

    def add_information(
        self,
        J: Array,
        log: Log,
        theta: Array,
        basis: Array,
        first: Array,
        noise: Array,
        root: bool = False,
    ) -> bool:
        """Adds a log's information about θ_⊥ to J (d, d); returns whether M and S stayed ≻ 0.

        Args:
            J: (d, d) information.
            log: the motion.
            theta: (p,) at which the system is linearised.
            basis: (p, d) Z of θ/scale = Z θ_⊥ + const.
            first: (2n,) variances of the state at the first sample.
            noise: (2n,) variances of the noise at all others.
            root: whether J holds an upper triangular A with Aᵀ A in its place.
        """
        own = (self.structure.arrays, *self.structure.memory())
        scale = np.array(self.space.scale)
        return bool(information_along(*own, theta, scale, basis, first, noise, *log, J, root))

    # -- regressors of samples, unchecked --------------------------------------------------------

    def _regressors(
        self, q: Array, v: Array, u: Array, w: Array, a: Array, weight: float = 1.0
    ) -> Array:
        """(N, n, p) combined regressor W = W_M + W_C − F (10) of N samples.

        `weight` is 1, or 0 to omit F and the weight of rigid bodies: W_M θ = M(q, θ) a (8), and
        W_C θ = C(q, v, θ) w (9) with Ṁ − 2C skew; F θ is the sum of all forces: gravity,
        dissipation, actuation.
        """
        W = np.empty((len(q), self.n, self.p))
        own = self._memory
        given = (q, v, u, w, a)
        if weight == 0.0:
            own.F[:] = 0.0
        write_regressors(
            self.structure.arrays, *map(plain, given), weight, own.state, own.F, own.work, W
        )
        if self.reference is not None:
            self.reference.overwrite(W, q, v, w, a, weight)
        return W

    def _at_times(self, t: Array, q: Array, v: Array, u: Array, w: Array, a: Array) -> Array:
        """(N, n, p) W of N samples; no structure depends on t (N,)."""
        return self._regressors(q, v, u, w, a)

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        """(n, p) W of one sample."""
        return self._regressors(q[None], v[None], u[None], w[None], a[None])[0]

    def _moving(self, q: Array, v: Array, w: Array, a: Array) -> Array:
        """(N, n, p) W_M + W_C of N samples."""
        return self._regressors(q, v, np.zeros((len(q), self.n_u)), w, a, 0.0)

    def _W_M(self, q: Array, a: Array) -> Array:
        """(n, p) of one sample."""
        return self._moving(q[None], self._still[None], self._still[None], a[None])[0]

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        """(n, p) of one sample."""
        return self._moving(q[None], v[None], w[None], self._still[None])[0]

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        """(n, p) of one sample."""
        return self.forces(np.array([t]), q[None], v[None], u[None])[0]

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F = −W without motion, of t (N,), q (N, m), v (N, n) and u (N, n_u)."""
        still = np.zeros(v.shape)
        return -self._regressors(q, v, u, still, still)

    def _mass_tensors(self, q: Array) -> Array:
        """(N, n, n, p), entry [k, j] is W_M(q_k, e_j): M(q_k, θ) = tensor · θ for every θ."""
        N = len(q)
        n = self.n
        still = np.zeros((len(q) * self.n, self.n))
        W = self._moving(q.repeat(n, axis=0), still, still, np.tile(np.eye(n), (N, 1)))
        return W.reshape(N, n, n, self.p)

    def _mass_tensor(self, q: Array) -> Array:
        return self._mass_tensors(q[None])[0]

    def stages(
        self, t: Array, q: Array, v: Array, u: Array, w: Array, theta: Array
    ) -> tuple[Array, Array, Array]:
        """What `Stage` holds at N samples: (N, n), (N, n, p) and (N,); â is the structure's.

        t is (N,), q (N, m), v (N, n), u (N, n_u), w (N, n), theta (N, p).
        """
        a = np.empty((len(q), self.n))
        pivots = np.empty(len(q))
        own = self._memory
        given = map(plain, (q, v, u, w, theta))
        accelerate_at(self.structure.arrays, *given, own.state, own.F, own.work, a, pivots)
        failed = ~(pivots > 0)
        a[failed] = 0.0
        W = self._regressors(q, v, u, w, a)
        a[failed] = np.nan
        return a, W, pivots

    # -- what follows, for one sample or batches -------------------------------------------------

    @cached_property
    def p(self) -> int:
        """Number of parameters."""
        return len(self.space)

    def split(self, x: Array) -> tuple[Array, Array]:
        """(q, v) of x (..., m+n).

        Raises:
            InvalidInput: the last axis is not m+n long.
        """
        x = np.asarray(x, dtype=np.float64)
        if x.ndim == 0 or x.shape[-1] != self.m + self.n:
            raise InvalidInput(
                "x",
                f"a last axis of m + n = {self.m} + {self.n}",
                f"shape {x.shape}",
                "x is the position followed by the velocity.",
            )
        return x[..., : self.m], x[..., self.m :]

    def W_M(self, x: Array, a: Array) -> Array:
        """(..., n, p) inertial regressor, W_M θ = M(x, θ) a (8)."""
        lengths = (self.m, self.n, self.n, self.n)
        still = self._still
        return _batched(self._moving, lengths, self.split(x)[0], still, still, a)

    def W_C(self, x: Array, w: Array) -> Array:
        """(..., n, p) Coriolis regressor, W_C θ = C(x, θ) w (9)."""
        lengths = self.m, self.n, self.n, self.n
        return _batched(self._moving, lengths, *self.split(x), w, self._still)

    def F(self, t: Array | float, x: Array, u: Array) -> Array:
        """(..., n, p) force regressor of (4)."""
        return _batched(self.forces, (0, self.m, self.n, self.n_u), t, *self.split(x), u)

    def regressor(self, t: Array | float, x: Array, w: Array, a: Array, u: Array) -> Array:
        """(..., n, p) combined regressor W = W_M + W_C − F (10)."""
        lengths = 0, self.m, self.n, self.n_u, self.n, self.n
        return _batched(self._at_times, lengths, t, *self.split(x), u, w, a)

    def mass_matrix(self, x: Array, theta: Array) -> Array:
        """(..., n, n) M(x, θ), the matrix of (8)."""
        q, _ = self.split(x)
        theta = self.space.check(theta)

        def matrices(q: Array) -> Array:  # some tensors (n, n, p) at a time
            parts = (q[k : k + _TOGETHER] for k in range(0, max(len(q), 1), _TOGETHER))
            return np.concatenate([self._mass_tensors(part) @ theta for part in parts])

        return _batched(matrices, (self.m,), q)

    def coriolis_matrix(self, x: Array, theta: Array) -> Array:
        """(..., n, n) C(x, θ), the matrix of (9)."""
        theta = self.space.check(theta)
        columns = [
            self.W_C(x, np.broadcast_to(e, np.shape(x)[:-1] + e.shape)) @ theta
            for e in np.eye(self.n)
        ]
        return np.stack(columns, axis=-1)

    def acceleration(self, t: Array | float, x: Array, w: Array, u: Array, theta: Array) -> Array:
        """(..., n) v̇(t, x, w, θ) = M(x, θ)⁻¹ [−W_C(x, w) + F(t, x)] θ (29)."""
        theta = self.space.check(theta)
        force = (self.F(t, x, u) - self.W_C(x, w)) @ theta
        a = np.linalg.solve(self.mass_matrix(x, theta), force[..., None])[..., 0]
        return np.asarray(a, dtype=np.float64)

    def evaluate(self, t: Array, x: Array, w: Array, u: Array, theta: Array) -> tuple[Array, Array]:
        """The acceleration (29) and the regressor (10) of N samples; unchecked.

        Args:
            t: (N,) times [s].
            x: (N, m+n) measured states.
            w: (N, n) velocities that C multiplies.
            u: (N, n_u) commands.
            theta: (p,) or (N, p) parameters.

        Returns:
            (N, n) v̇(t, x, w, θ) (29), and (N, n, p) W(t, x, w, v̇) (10).
        """
        q, v = self.split(x)
        thetas = np.broadcast_to(theta, (len(t), self.p))
        a, W, pivots = self.stages(t, q, v, u, w, thetas)
        for k in np.flatnonzero(~(pivots > 0)):  # M is not positive definite: solve by LU
            a[k] = self.acceleration(t[k], x[k], w[k], u[k], thetas[k])
            W[k] = self._W(float(t[k]), q[k], v[k], w[k], a[k], u[k])
        return a, W

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """(29), (10, 31) and M̂'s pivot at a sample (t, q, v, u), for velocity w and estimate θ."""
        rows = (np.asarray(each, dtype=np.float64)[None] for each in (t, q, v, u, w, theta))
        a, W, pivots = self.stages(*rows)
        return Stage(a[0], W[0], float(pivots[0]))


def _batched(
    function: Callable[..., Array], lengths: tuple[int, ...], *arguments: ArrayLike
) -> Array:
    """Applies a function of N samples over the leading axes of its arguments.

    `lengths` are those of the arguments' last axes, 0 for a number.
    """
    arrays = [np.asarray(argument, dtype=np.float64) for argument in arguments]
    for array, length in zip(arrays, lengths, strict=True):
        if length and array.shape[-1:] != (length,):
            raise InvalidInput(
                "argument",
                f"a last axis of length {length}",
                f"shape {array.shape}",
                "Give one row for each sample.",
            )
    ends = [(length,) if length else () for length in lengths]
    pairs = list(zip(arrays, ends, strict=True))
    batch = np.broadcast_shapes(*(array.shape[: array.ndim - len(end)] for array, end in pairs))
    samples = [np.broadcast_to(array, batch + end).reshape(-1, *end) for array, end in pairs]
    found = function(*samples)
    return found.reshape(batch + found.shape[1:])


def checked(system: SecondOrderSystem, measurement: Measurement) -> Measurement:
    """Checks a measurement's shapes and that it is finite, and converts it to float arrays.

    Raises:
        InvalidInput: a shape differs from the system's, or a value is NaN or infinite.
    """
    remedy = "A measurement is (t, q, v, u) in the system's own coordinates."
    t, q, v, u = measurement
    return Measurement(
        float(finite("t", t, (), remedy)),
        finite("q", q, (system.m,), remedy),
        finite("v", v, (system.n,), remedy),
        finite("u", u, (system.n_u,), remedy),
    )
