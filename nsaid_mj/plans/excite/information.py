"""The objective of a design, and a motion's information: Cramér–Rao bound, Gramian on P_⊥, rank."""

import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.linalg

from ...base import InvalidInput, NoEstimate, UnknownName
from ...core import Array, Log, Nullspace, ParameterSpace
from ...lab import DriverConfig, FourierTracking
from .experiment import Experiment
from .limits import Limits
from .motions import JointMotions

GAINS = "gains"
ALL = "all"


@dataclass(frozen=True)
class Asked:
    """Numbers that are linear in small changes of θ."""

    words: str  # description for reports
    names: tuple[str, ...]  # one for each number
    rows: Callable[[Array], Array]  # θ (p,) → (k, p) derivatives of the numbers by θ/scale

    def deviations(self, covariance: Array, theta: Array) -> Array:
        """(k,) standard deviations under a covariance (p, p) of θ̂/scale, at θ."""
        rows = self.rows(theta)
        return np.sqrt(np.maximum(np.einsum("kp,pq,kq->k", rows, covariance, rows), 0.0))


def asked_for(text: str, space: ParameterSpace) -> Asked:
    """Parses `gains`, `all`, or comma-separated names of parameters.

    `gains` are the ratios k_i/mean(k), which do not depend on the unknown common scale, and `all`
    the changes of θ/scale. Named parameters are relative to their magnitude, or to a tenth of their
    scale if that is larger. The common scale and the rest of P_s are held fixed. A link's mass m_i
    may be written mass_i.

    Raises:
        UnknownName: there is no such parameter, or the system has no actuator.
    """
    if text == GAINS:
        if len(space.actuators) < 2:
            remedy = f"Ask for {ALL}, or for parameters by name: there is no ratio of gains."
            raise UnknownName("target", text, [ALL, *space.names], remedy)
        names = tuple(space.names[i] for i in space.actuators)
        return Asked("ratios of the actuators' gains", names, _gains(space))
    if text == ALL:
        eye = np.eye(len(space))
        return Asked("all parameters", tuple(space.names), lambda _: eye)
    names = tuple(
        re.sub(r"^mass(?=_\d+$)", "m", part.strip()) for part in text.split(",") if part.strip()
    )
    for name in names or ("",):
        if name not in space.names:
            raise UnknownName("parameter", name, [GAINS, ALL, *space.names])
    at = np.array([space.index(name) for name in names])
    chosen = np.eye(len(space))[at]

    def rows(theta: Array) -> Array:
        size = np.maximum(np.abs(theta[at]), 0.1 * space.scale[at])
        return chosen * (space.scale[at] / size)[:, None]

    return Asked(", ".join(space.labels[i] for i in at), names, rows)


def _gains(space: ParameterSpace) -> Callable[[Array], Array]:
    at = space.actuators

    def rows(theta: Array) -> Array:
        """Derivatives of k_i/mean(k) at equal relative errors: (1 − mean) of δk_i/k_i."""
        found = np.zeros((len(at), len(space)))
        share = np.eye(len(at)) - 1 / len(at)
        found[:, at] = share * (space.scale[at] / theta[at])
        return found

    return rows


PRIOR = 0.3
"""Standard deviation of θ/scale before any data, in every direction, for an unknown robot."""


def predicted(experiment: Experiment, log: Log, draw: int) -> Array:
    """(p, p) Cramér–Rao bound on the covariance of θ̂/scale after a motion, under a draw.

    The motion may be given at coarser steps than the measurements.

    Raises:
        NoEstimate: M is not positive definite along the motion.
    """
    basis = experiment.bases[draw]
    return bound(information(experiment, log, draw, basis), basis)


def information(experiment: Experiment, log: Log, draw: int, basis: Array) -> Array:
    """(d, d) a motion's information about Zᵀθ/scale under a draw, without prior knowledge.

    `basis` (p, d) is Z, orthonormal; the other directions of θ/scale are assumed known.

    White noise of variance σ² at every dt carries as much information per second as noise of
    variance σ² dt/h at every h. So a motion given at coarser steps has nearly the same bound, as
    long as the steps resolve it.

    Raises:
        NoEstimate: M is not positive definite along the motion.
    """
    system = experiment.system
    theta = experiment.draws[draw]
    h = float(log.t[1] - log.t[0])
    R = np.repeat(np.array(experiment.levels) ** 2, system.n)
    J = np.zeros((basis.shape[1],) * 2)
    coarser = experiment.scenario.dt / h * R
    if not system.add_information(J, log, theta, basis, R, coarser):
        raise NoEstimate("M is not positive definite along the motion", "Check the parameters.")
    return J


def bound(J: Array, basis: Array) -> Array:
    """(p, p) covariance of θ̂/scale under the information J (d, d) of motions and the prior."""
    J = J + np.eye(len(J)) / PRIOR**2
    root = np.linalg.solve(np.linalg.cholesky(J), basis.T)
    return root.T @ root


def gramian(experiment: Experiment, log: Log, theta: Array) -> Array:
    """(p, p) mean of S Wᵀ M⁻¹ W S along a motion, S = diag(scale), at θ."""
    system = experiment.system
    rows = system.acceleration_rows(log, theta)
    if rows is None:
        raise NoEstimate("M is not positive definite along the motion", "Check the parameters.")
    M = system.mass_matrix(np.hstack([log.q, log.v]), theta)
    weighted = (np.linalg.cholesky(M).transpose(0, 2, 1) @ rows).reshape(-1, system.p)
    return weighted.T @ weighted / len(log.t)  # M⁻¹ W S = −rows, so this is rowsᵀ M rows


def gramian_cost(
    experiment: Experiment, asked: Asked, log: Log, draw: int, criterion: str
) -> float:
    """A criterion of the Gramian on P_⊥; the null directions are excluded.

    `bound` is the rms deviation of the requested numbers if the accelerations alone were measured:
    it has the shape of the Gramian, but neglects the filtering of sensor noise.
    """
    theta = experiment.draws[draw]
    basis = experiment.bases[draw]
    own = basis.T @ gramian(experiment, log, theta) @ basis
    values, vectors = scipy.linalg.eigh(own)
    values = np.maximum(values, 1e-14 * values[-1])
    if criterion == "condition":
        return float(np.sqrt(values[-1] / values[0]))
    if criterion == "d-optimal":
        return float(-np.sum(np.log(values)))
    count = experiment.scenario.duration / experiment.scenario.dt
    information = count * values / experiment.levels.velocity**2 + 1 / PRIOR**2
    root = basis @ (vectors / np.sqrt(information))
    return rms(asked.deviations(root @ root.T, theta))


def bound_cost(experiment: Experiment, asked: Asked, log: Log, draw: int) -> float:
    """The rms standard deviation of the requested numbers, by the bound; inf if M̂ fails."""
    try:
        covariance = predicted(experiment, log, draw)
    except (NoEstimate, InvalidInput):
        return np.inf
    return rms(asked.deviations(covariance, experiment.draws[draw]))


def rms(x: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


_SAMPLES = 1500  # of a motion, at most
_MOST = 8


@dataclass(frozen=True)
class Ranks:
    """Ranks of motions with few harmonics."""

    needed: int  # p − r of the structure: the dimension of P_⊥
    # number of harmonics that a system with a regressor linear in its signals needs at least:
    # n (2h + 1) ≥ p − r
    bound: int
    measured: tuple[tuple[int, int], ...]  # (h, rank) of random motions with h harmonics per signal

    @property
    def enough(self) -> int | None:
        """The smallest number of harmonics found to excite all of P_⊥."""
        return next((h for h, rank in self.measured if rank >= self.needed), None)


def ranks(experiment: Experiment, limits: Limits, seed: int = 0) -> Ranks:
    """Measures the rank of motions with 1, 2, … harmonics, until P_⊥ is excited."""
    system = experiment.system
    base = experiment.scenario.excitation
    needed = system.p - experiment.nullspace.r
    bound = max(1, int(np.ceil((needed / system.n - 1) / 2)))
    measured = []
    for count in range(1, _MOST + 1):
        log = _motion(experiment, limits, base, count, seed)
        if log is None:
            break
        measured.append((count, _rank(experiment, log)))
        if measured[-1][1] >= needed:
            break
    return Ranks(needed, bound, tuple(measured))


def _motion(
    experiment: Experiment, limits: Limits, base: DriverConfig, count: int, seed: int
) -> Log | None:
    """A random motion with few harmonics, under the prior's first draw."""
    rng = np.random.default_rng(seed)
    if isinstance(base, FourierTracking):
        if count > base.harmonics:
            return None
        motions = JointMotions(experiment, limits, replace(base, harmonics=count))
        return motions.motion(motions.series(motions.random(rng)), 0)[0]
    if "tones" not in {f.name for f in fields(base)}:
        return None
    few = replace(base, tones=count)  # type: ignore[call-arg]  # a driver with tones
    return experiment.simulate(few, 0, experiment.scenario.duration, seed)


def _rank(experiment: Experiment, log: Log) -> int:
    """Rank of W·diag(scale) along a motion, with v̇ by (29)."""
    system = experiment.system
    t, q, v, u = (part[:: max(1, len(log.t) // _SAMPLES)] for part in log)
    x = np.hstack([q, v])
    _, W = system.evaluate(t, x, v, u, experiment.draws[0])
    rows = (W * system.space.scale).reshape(-1, system.p)
    return system.p - Nullspace.of(rows).r
