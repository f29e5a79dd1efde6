"""Commands that exert a given force under an estimate of the actuators' gains.

F(u) θ̂ − F(0) θ̂ = B(θ̂) f(u), with B the force per unit of effort, linear in the gains, and f the
actuators' known command curves. Over-actuated groups take a weighted right inverse of B.
"""

from dataclasses import dataclass

import numpy as np

from ....base import InvalidInput
from ....core import Array, Indices, SecondOrderSystem

_KNOTS = 4001  # of a tabulated command curve: relative errors of 1e-7 for smooth curves
_PROBES = 4
_RANK = 1e-6  # smallest singular value of a group's B, relative to the largest


@dataclass(frozen=True)
class ActuatedGroup:
    """Indices of velocities, and of the commands (at least as many) that act on these alone."""

    rows: Indices
    columns: Indices


class Actuation:
    """The actuators of a fully or over-actuated system.

    Under the gains of prior (p,) they must span all velocities; low and high (n_u,) are the
    smallest and largest commands, the attribute high less where a command curve falls off before;
    rest (n_u,) are preferred efforts of redundant actuators. The attribute `gains` has their
    indices in θ.

    Raises:
        InvalidInput: the system is under-actuated, or its forces are not a sum over commands.
    """

    def __init__(
        self, system: SecondOrderSystem, prior: Array, low: Array, high: Array, rest: Array
    ):
        self.gains = system.space.actuators
        self._unit = unit_forces(system)
        self._rest = rest
        knots = np.linspace(low, high, _KNOTS)
        self._commands, self._efforts = curves(system, self._unit, knots)
        self.low = np.array([u[0] for u in self._commands])
        self.high = np.array([u[-1] for u in self._commands])
        self._least = np.array([f[0] for f in self._efforts])
        self._most = np.array([f[-1] for f in self._efforts])
        curved = zip(self._commands, self._efforts, strict=True)
        self._linear = all(np.allclose(u, f, rtol=0, atol=1e-12) for u, f in curved)
        self.groups = groups(system, self.matrix(prior))
        single = [g for g in self.groups if len(g.rows) == len(g.columns) == 1]
        self._several = [g for g in self.groups if len(g.columns) > 1]
        self._own = np.array([[g.rows[0], g.columns[0]] for g in single], dtype=np.intp)

    def matrix(self, theta: Array) -> Array:
        """(n, n_u) B(θ), the force per unit of every actuator's effort."""
        return np.asarray(self._unit @ theta[self.gains])

    def command(self, theta: Array, force: Array) -> Array:
        """(n_u,) the command u with B(θ) f(u) = force (n,), as far as the limits allow.

        Within a group f = f₀ + N Bᵀ (B N Bᵀ)⁻¹ (force − B f₀) is the solution closest to the
        efforts f₀ preferred at rest, in units of the actuators' ranges, N = diag(range²). Where it
        exceeds a limit, the group's force is scaled down, which keeps its direction.
        """
        B = self.matrix(theta)
        effort = np.empty(len(self._rest))
        if len(self._own):
            rows, columns = self._own.T
            wanted = force[rows] / B[rows, columns]
            effort[columns] = np.clip(wanted, self._least[columns], self._most[columns])
        for group in self._several:
            effort[group.columns] = self._share(B, force, group)
        if self._linear:
            return effort
        return np.array(
            [np.interp(effort[i], f, self._commands[i]) for i, f in enumerate(self._efforts)]
        )

    def _share(self, B: Array, force: Array, group: ActuatedGroup) -> Array:
        """Efforts of a group's actuators, scaled to be within their limits."""
        k = group.columns
        own = B[np.ix_(group.rows, group.columns)]
        least = self._least[k]
        most = self._most[k]
        weighted = (most - least) ** 2 * own
        inverse = weighted.T @ np.linalg.inv(own @ weighted.T)
        at_rest = self._rest[k] - inverse @ (own @ self._rest[k])  # exerts nothing
        at_rest = np.clip(at_rest, least, most)
        step = inverse @ force[group.rows]
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step > 0, (most - at_rest) / step, (least - at_rest) / step)
        return at_rest + min(1.0, float(np.nanmin(room))) * step


def unit_forces(system: SecondOrderSystem) -> Array:
    """(n, n_u, a) force per unit of effort and of every actuator parameter.

    Raises:
        InvalidInput: the forces of the commands depend on the state, or on each other.
    """
    rng = np.random.default_rng(0)
    found = []
    for _ in range(_PROBES):
        q, v, u = system.random_state(rng)
        zero = system._F(0.0, q, v, np.zeros(system.n_u))
        moved = [system._F(0.0, q, v, e) - zero for e in np.eye(system.n_u)]
        found.append(np.stack([one[:, system.space.actuators] for one in moved], axis=1))
        whole = system._F(0.0, q, v, u) - zero
        apart = sum(system._F(0.0, q, v, e) - zero for e in np.diag(u))
        found_apart = np.abs(whole - apart).max() + np.abs(found[-1] - found[0]).max()
        if not found_apart <= 1e-9 * np.abs(found[0]).max():
            raise InvalidInput(
                "excitation",
                "actuators whose forces depend on their own commands alone",
                type(system).__name__,
                "Adaptive tracking is for motors, thrusters and nozzles: use another driver.",
            )
    return found[0]


def curves(system: SecondOrderSystem, unit: Array, knots: Array) -> tuple[list[Array], list[Array]]:
    """Tabulates every actuator's effort over the range around 0 in which it grows with the command.

    `unit` (n, n_u, a) is that of `unit_forces`, `knots` (k, n_u) are commands. Returns, for every
    actuator, its commands and the efforts there, both increasing.
    """
    (q, v, _), count = system.random_state(np.random.default_rng(0)), len(knots)
    still = np.zeros(count), np.tile(q, (count, 1)), np.tile(v, (count, 1))
    gains = system.space.actuators
    commands = []
    efforts = []
    zero = system._F(0.0, q, v, np.zeros(system.n_u))[:, gains]
    for i in range(system.n_u):
        u = np.zeros((count, system.n_u))
        u[:, i] = knots[:, i]
        push = system.forces(*still, u)[:, :, gains] - zero
        effort = np.sum(push * unit[:, i], axis=(1, 2)) / np.sum(unit[:, i] ** 2)
        middle = int(np.argmin(np.abs(knots[:, i])))
        grows = np.diff(effort) > 0
        last = middle + int(np.argmin(np.r_[grows[middle:], False]))
        first = middle - int(np.argmin(np.r_[grows[:middle][::-1], False]))
        commands.append(knots[first : last + 1, i].copy())
        efforts.append(effort[first : last + 1].copy())
    return commands, efforts


def groups(system: SecondOrderSystem, B: Array) -> list[ActuatedGroup]:
    """The smallest decoupled groups of velocities and commands.

    Raises:
        InvalidInput: a group's commands cannot exert every force along its velocities.
    """
    found = []
    left = set(range(system.n))
    while left:
        rows = {min(left)}
        columns = set()
        while True:
            more = set(np.flatnonzero(np.any(B[sorted(rows)] != 0, axis=0)).tolist())
            wider = rows | set(np.flatnonzero(np.any(B[:, sorted(more)] != 0, axis=1)).tolist())
            if more == columns and wider == rows:
                break
            rows = wider
            columns = more
        group = ActuatedGroup(np.array(sorted(rows)), np.array(sorted(columns), dtype=np.intp))
        part = B[np.ix_(group.rows, group.columns)]
        size = np.linalg.svd(part, compute_uv=False) if part.size else np.zeros(1)
        if len(columns) < len(rows) or not size.min() > _RANK * size.max():
            raise InvalidInput(
                "excitation",
                "an actuator for every direction of motion",
                f"{system.n_u} commands that do not span {system.n} velocities, an under-actuated "
                f"{type(system).__name__}",
                "Adaptive tracking needs a fully actuated robot: an arm on a fixed base, bluerov2, "
                "astrobee or uvms. Use another driver.",
            )
        found.append(group)
        left -= rows
    return found
