"""The paper's class of systems: W(t, x, v, v̇) θ = 0.

A `SecondOrderSystem` is structure only. It knows which columns multiply which parameter and holds
no parameter's value. Subclasses supply W_M, W_C, F and the kinematics for one sample; batches,
the combined regressor (10), the mass matrix (8) and the acceleration (29) follow from them here.

Symbols: q (m,) position, v (n,) measured velocity, x = (q, v) (m+n,) the combined state (3),
w (n,) the velocity that C multiplies (the identifier's v̂ or the measured v), a (n,)
acceleration, u command, θ (p,) parameters. F is always evaluated at the measured x.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .errors import InvalidInput
from .log import Log, Measurement
from .numerics.linalg import evaluate
from .parameters import Array, Indices, ParameterSpace, finite

DIFFERENCE = 1e-5  # of the central differences along v [s·(1 + |v|)]


class ConstantInertia(NamedTuple):
    """M(θ) of a body in its own frame, sparse.

    Attributes:
        entries: (e, 3) rows [i, j, k]: M_ij holds θ_k …
        values: (e,) … times this.
    """

    entries: Indices
    values: Array


class Linkage(NamedTuple):
    """A tree of bodies on 1-DOF joints, the first on a free flyer or not, for `recursion`.

    Attributes:
        joints: (b, 40) of every body's joint: nine numbers each of R₀, R_c and R_s, the body's axes
            in its parent's being R₀ + R_c cos + R_s sin; its place [m], the way it slides, its
            unit twist [v, ω], the speed at which Coulomb friction is developed [rad/s or m/s].
        numbers: (b, 3) rows [parent or −1, where q holds the joint's number, kind of joint].
        gravity: (3,) in the world's axes [m/s²].
        columns: (4,) where rotor inertias, viscous and Coulomb friction and motor gains begin in θ;
            the first two are equal where there are no rotors. The links begin at 0.
    """

    joints: Array
    numbers: Indices
    gravity: Array
    columns: Indices


class LoadedTree(NamedTuple):
    """A tree whose base floats and whose bodies carry inertias of any kind, for `loaded`.

    Entry (i, j) of a body's 6×6 inertia, in its own frame, is numbered 72 body + 6 i + j where it
    only resists acceleration, as added mass does, and 36 more where it has weight.

    Attributes:
        linkage: how the bodies hang together. Its `columns` say where the inertias end in θ.
        places: (e,) what number an entry has …
        parameters: (e,) that holds this parameter of θ …
        values: (e,) … times this.
    """

    linkage: Linkage
    places: Indices
    parameters: Indices
    values: Array


class SecondOrderSystem(ABC):
    """M(x, θ) v̇ + C(x, θ) v = F(t, x, u) θ (4), linear in θ (8, 9), with Ṁ − 2C skew.

    Attributes:
        space: names, units and scale of θ.
        n: number of velocities.
        m: number of positions.
        n_u: number of commands.
        velocity_units: one SI unit for each velocity.
        group: how many of the leading velocities are a body twist: 6 in space, 3 in the plane, 0
            where all velocities are rates of numbers. See `spatial`.
        inertia: M, where it does not depend on the position; then C w = −ad_wᵀ M v in that group,
            and an identifier need not form W_M and W_C.
        linkage: the tree, where its bodies are moved by compiled recursions.
        loaded: the tree, where its bodies carry more than their own mass; what else acts on them
            is said by `applied`.
        mounts: (k, 3) where the force of every actuator parameter acts in the body's axes [m], NaN
            where it makes none; None where there is nothing to draw.
    """

    group: int = 0
    inertia: ConstantInertia | None = None
    linkage: Linkage | None = None
    loaded: LoadedTree | None = None
    mounts: Array | None = None

    space: ParameterSpace
    velocity_units: tuple[str, ...]
    n: int
    m: int
    n_u: int

    # -- what a system supplies, for one sample ------------------------------------------------

    @abstractmethod
    def _W_M(self, q: Array, a: Array) -> Array:
        """(n, p) with W_M θ = M(q, θ) a (8)."""

    @abstractmethod
    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        """(n, p) with W_C θ = C(q, v, θ) w (9), Ṁ − 2C skew."""

    @abstractmethod
    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        """(n, p) with F θ = all forces: gravity, dissipation, actuation."""

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        """(n, p) combined regressor (10); override where that is cheaper than its parts."""
        return self._W_M(q, a) + self._W_C(q, v, w) - self._F(t, q, v, u)

    @abstractmethod
    def integrate(self, q: Array, dq: Array) -> Array:
        """(m,) the position reached from q by the tangent step dq (n,)."""

    @abstractmethod
    def difference(self, q0: Array, q1: Array) -> Array:
        """(n,) the tangent step that leads from q0 to q1."""

    @abstractmethod
    def J(self, q: Array) -> Array:
        """(m, n) of the kinematics, where q̇ is this times v (3)."""

    @abstractmethod
    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws (q, v, u) of the size seen in operation, to probe the structure."""

    def position(self, coordinates: Array) -> Array:
        """(..., m) q of position numbers (..., n), one for each velocity, as sensors give them."""
        return np.array(coordinates, dtype=np.float64)

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples t (N,), q (N, m), v (N, n), u (N, n_u); unchecked."""
        rows = zip(t.tolist(), q, v, u, strict=True)
        return np.stack([self._F(*row) for row in rows])

    def applied(self, states: Array, u: Array) -> Array:
        """(N, n, k) the last k columns of F, of what acts on a `loaded` tree's bodies but weight.

        Args:
            states: (N, b, ·) of `recursion`.
            u: (N, n_u) commands.
        """
        return np.zeros((len(u), self.n, 0))

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """What the momentum balance behind a leak is made of, along a log of N samples; unchecked.

        Args:
            leak: its rate a [1/s].
            log: the samples.
            q: (N−1, m) positions half-way between them.
            v: (N−1, n) velocities there.

        Returns:
            (N, n, p) W_M(q, v) at the samples; and (N−1, n, p) a W_M(q, v) + F + the regressor of
            Cᵀ v at start, middle and end of every step, its command held.
        """
        t, held = log.t, log.u[:-1]
        momenta = np.stack([self._W_M(*row) for row in zip(log.q, log.v, strict=True)])
        drive = leak * momenta
        drive += np.stack([self._transport(*row) for row in zip(log.q, log.v, strict=True)])
        half = self.forces(0.5 * (t[:-1] + t[1:]), q, v, held)
        half += np.stack([leak * self._W_M(*row) + self._transport(*row)
                          for row in zip(q, v, strict=True)])  # fmt: skip
        start = drive[:-1] + self.forces(t[:-1], log.q[:-1], log.v[:-1], held)
        end = drive[1:] + self.forces(t[1:], log.q[1:], log.v[1:], held)
        return momenta, start, half, end

    def _mass_tensor(self, q: Array) -> Array:
        """(n, n, p), entry [j] is W_M(q, e_j): M(q, θ) = tensor · θ for every θ."""
        return np.stack([self._W_M(q, e) for e in np.eye(self.n)])

    def _transport(self, q: Array, v: Array) -> Array:
        """(n, p) regressor of C(x)ᵀ v = Ṁ v − C v, so that d/dt(M v) = F θ + Cᵀ v.

        Ṁ v by central differences along v here, good to about 1e-10 of it; override where it has
        a closed form.
        """
        step = DIFFERENCE / (1.0 + np.abs(v).max(initial=0.0))
        ahead, behind = self.integrate(q, step * v), self.integrate(q, -step * v)
        return (self._W_M(ahead, v) - self._W_M(behind, v)) / (2 * step) - self._W_C(q, v, v)

    # -- what follows, for one sample or batches -----------------------------------------------

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
        q, _ = self.split(x)
        return _each(self._W_M, (self.m, self.n), q, a)

    def W_C(self, x: Array, w: Array) -> Array:
        """(..., n, p) Coriolis regressor, W_C θ = C(x, θ) w (9)."""
        q, v = self.split(x)
        return _each(self._W_C, (self.m, self.n, self.n), q, v, w)

    def F(self, t: Array | float, x: Array, u: Array) -> Array:
        """(..., n, p) force regressor of (4)."""
        q, v = self.split(x)
        return _each(
            lambda t, q, v, u: self._F(float(t), q, v, u), (0, self.m, self.n, self.n_u), t, q, v, u
        )

    def regressor(self, t: Array | float, x: Array, w: Array, a: Array, u: Array) -> Array:
        """(..., n, p) combined regressor W = W_M + W_C − F (10)."""
        q, v = self.split(x)
        return _each(
            lambda t, q, v, w, a, u: self._W(float(t), q, v, w, a, u),
            (0, self.m, self.n, self.n, self.n, self.n_u),
            *(t, q, v, w, a, u),
        )

    def mass_matrix(self, x: Array, theta: Array) -> Array:
        """(..., n, n) M(x, θ), the matrix of (8)."""
        q, _ = self.split(x)
        theta = self.space.check(theta)
        return _each(lambda q: self._mass_tensor(q) @ theta, (self.m,), q)

    def coriolis_matrix(self, x: Array, theta: Array) -> Array:
        """(..., n, n) C(x, θ), the matrix of (9)."""
        theta = self.space.check(theta)
        columns = [self.W_C(x, np.broadcast_to(e, np.shape(x)[:-1] + e.shape)) @ theta
                   for e in np.eye(self.n)]  # fmt: skip
        return np.stack(columns, axis=-1)

    def acceleration(self, t: Array | float, x: Array, w: Array, u: Array, theta: Array) -> Array:
        """(..., n) v̇(t, x, w, θ) = M(x, θ)⁻¹ [−W_C(x, w) + F(t, x)] θ (29)."""
        theta = self.space.check(theta)
        force = (self.F(t, x, u) - self.W_C(x, w)) @ theta
        a = np.linalg.solve(self.mass_matrix(x, theta), force[..., None])[..., 0]
        return np.asarray(a, dtype=np.float64)

    def evaluate(self, t: Array, x: Array, w: Array, u: Array, theta: Array) -> tuple[Array, Array]:
        """What `acceleration` is, and `regressor` at it, of N samples in less time; unchecked.

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
        a, W = np.empty((len(t), self.n)), np.empty((len(t), self.n, self.p))
        thetas = np.broadcast_to(theta, (len(t), self.p))
        for k, (time, *rest) in enumerate(zip(t.tolist(), q, v, u, w, thetas, strict=True)):
            a[k], W[k], pivot = self.at(time, *rest[:3]).evaluate(*rest[3:])
            if not pivot > 0:  # an identifier would stop here
                a[k] = self.acceleration(time, x[k], w[k], u[k], thetas[k])
                W[k] = self._W(time, q[k], v[k], w[k], a[k], u[k])
        return a, W

    def at(self, t: float, q: Array, v: Array, u: Array) -> Instant:
        """The system at one measured state and command."""
        return Instant(self, t, q, v, u)


class Instant:
    """A system at one measured state and command: what depends on these alone, computed once.

    The base class works for any system; a system with a faster way overrides `at`.

    Attributes:
        system: whose structure it is.
        t: time [s].
        q: (m,) position.
        v: (n,) measured velocity.
        u: (n_u,) command.
    """

    def __init__(self, system: SecondOrderSystem, t: float, q: Array, v: Array, u: Array):
        self.system, self.t, self.q, self.v, self.u = system, t, q, v, u

    @cached_property
    def mass_tensor(self) -> Array:
        """(n, n, p) with M(x, θ) = mass_tensor · θ and W_M(x, a) = Σ_j a_j mass_tensor[j]."""
        return self.system._mass_tensor(self.q)

    @cached_property
    def F(self) -> Array:
        """(n, p) force regressor of (4)."""
        return self.system._F(self.t, self.q, self.v, self.u)

    def evaluate(self, w: Array, theta: Array) -> tuple[Array, Array, float]:
        """What an identifier needs at velocity w and estimate θ.

        Returns:
            (n,) acceleration v̇(t, x, w, θ) of (29), NaN where M is not positive definite;
            (n, p) regressor W(t, x, w, θ) of (10, 31);
            smallest pivot of M(x, θ), > 0 where it is positive definite.
        """
        W_C = self.system._W_C(self.q, self.v, w)
        return evaluate(self.mass_tensor, W_C, self.F, theta)

    def commanded(self, t: float, u: Array) -> Instant:
        """The same state under another command."""
        other = Instant(self.system, t, self.q, self.v, u)
        other.__dict__["mass_tensor"] = self.mass_tensor
        return other


def _each(function, lengths: tuple[int, ...], *arguments) -> Array:
    """Applies a one-sample function over the leading axes of its arguments."""
    arrays = [np.asarray(argument, dtype=np.float64) for argument in arguments]
    for array, length in zip(arrays, lengths, strict=True):
        if length and array.shape[-1:] != (length,):
            raise InvalidInput(
                "argument",
                f"a last axis of length {length}",
                f"shape {array.shape}",
                "Give one row for each sample.",
            )
    if all(array.ndim == (length > 0) for array, length in zip(arrays, lengths, strict=True)):
        return function(*arrays)  # one sample, as a controller asks a thousand times a second
    leading = [
        a.shape[:-1] if length else a.shape for a, length in zip(arrays, lengths, strict=True)
    ]
    batch = np.broadcast_shapes(*leading)
    spread = [
        np.broadcast_to(a, batch + (a.shape[-1:] if length else ())).reshape(
            (-1,) + (a.shape[-1:] if length else ())
        )
        for a, length in zip(arrays, lengths, strict=True)
    ]
    if not len(spread[0]):
        one = function(*(np.zeros(length) if length else np.zeros(()) for length in lengths))
        return np.zeros(batch + one.shape)
    results = np.stack([function(*sample) for sample in zip(*spread, strict=True)])
    return results.reshape(batch + results.shape[1:])


def checked(system: SecondOrderSystem, measurement: Measurement) -> Measurement:
    """The measurement, of the right shapes and finite.

    Raises:
        InvalidInput: a shape differs, or a value is NaN or infinite.
    """
    remedy = "A measurement is (t, q, v, u) in the system's own coordinates."
    t, q, v, u = measurement
    return Measurement(
        float(finite("t", t, (), remedy)),
        finite("q", q, (system.m,), remedy),
        finite("v", v, (system.n,), remedy),
        finite("u", u, (system.n_u,), remedy),
    )
