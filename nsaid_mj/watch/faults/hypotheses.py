"""Fault hypotheses about θ and about commands.

A hypothesis adds an unknown jump δ ~ N(0, 1) along each of its directions D (in θ/scale) to θ, so
P_θθ grows by D Dᵀ. Three of them also change the command that acts on an actuator: −u if it is
reversed, 0 if broken, and a typical constant command if stuck, whose effort is estimated as the
gain.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...core import (
    Array,
    Cone,
    Indices,
    KalmanFilter,
    ParameterSpace,
    SecondOrderSystem,
)
from .evidence import Jump

_GAIN = 0.5  # standard deviation of a gain's jump, relative to the gain
_OWN = 0.05  # of the difference between gains of one actuator, as thrust and torque of a rotor
_FRICTION = 1.0  # of the jump of a friction or drag, relative to its scale
_BODY = 0.5  # of that of a body's inertial parameters, relative to their scale
_LOAD = 0.1  # and at least this share of the whole robot's mass
_LOADS = (0.03, 0.1, 0.2, 0.3)  # masses of loads that are picked up, over the whole robot's
_DENSITY = 500.0  # of such a load [kg/m³]
_LOADED = 0.5  # standard deviation of its inertial parameters in the metric of the cone
_DISSIPATES = ("friction", "drag", "resistance")
_RARE = 5.0  # prior odds of a fault in one part [nats]: one of some fifty, no more likely together
_INEXACT = (2e-4, 2e-3, 2e-2, 0.2)  # shares by which all of θ may seem off where W is not exact
_RESTORED = 0.1  # standard deviation of a gain's jump back to what it was, relative to the gain


class Hypothesis(NamedTuple):
    """A possible cause of a change."""

    kind: str  # see `FaultEvent`; also `none`, and `sound` for a part that works again
    part: str  # the affected part, in words
    names: tuple[str, ...]  # names of the parameters that may have changed
    D: Array  # (p, d) directions of the jump of θ/scale, whose δ has standard deviation 1
    size: Array  # (d,) the reported size of the change is sizeᵀδ
    unit: str  # unit of the size; `1` for a share
    command: int = -1  # index of the actuator whose acting command differs; −1 if none
    held: float = np.nan  # the constant command that acts instead; NaN if there is none
    mean: Array | float = 0.0  # (p,) mean of the jump of θ/scale where it is not 0
    offset: float = 0.0  # part of the reported size that belongs to the mean
    # (2, N) sizes of an actuator's command, and the efforts relative to that at `held`
    curve: Array | None = None
    channel: int = -1  # index of the sensor with a constant error, positions first; −1 if none
    share: float = 0.0  # relative error of all of θ for an inexact structure; 0 for an exact one


def hypotheses_of(system: SecondOrderSystem, theta: Array) -> list[Hypothesis]:
    """All single faults of a system with the earlier estimate θ̂ (p,)."""
    robot = [*_actuators(system, theta), *_frictions(system), *_payloads(system, theta)]
    return [*robot, *_biases(system)]


def slow_changes(system: SecondOrderSystem, theta: Array) -> list[Hypothesis]:
    """The hypotheses that a slow shift of θ̂ (p,) can support."""
    faults = hypotheses_of(system, theta)
    slow = [h for h in faults if h.command < 0 and h.channel < 0 and not h.offset]
    return slow + inexact(system, theta)


def command_of(stuck: Hypothesis, held: float, ratio: float) -> float:
    """The command whose effort is `ratio` times that of another one, `held`, of the same sign."""
    assert stuck.curve is not None
    sizes, efforts = stuck.curve
    effort = float(np.interp(abs(held), sizes, efforts)) * max(0.0, ratio)
    return float(np.copysign(np.interp(effort, efforts, sizes), held)) + 0.0  # not −0


def together(share: Array, hypotheses: Sequence[Hypothesis], k: int) -> float:
    """Probability of hypothesis k, with that of others of the same kind and part.

    share (h,) are the probabilities of the hypotheses.
    """
    alike = [(h.kind, h.part) == (hypotheses[k].kind, hypotheses[k].part) for h in hypotheses]
    return min(1.0, sum(float(p) for p, same in zip(share, alike, strict=True) if same))


def penalty(hypothesis: Hypothesis) -> float:
    """Negative log prior odds of a hypothesis against no failure [nats]."""
    return 0.0 if hypothesis.kind in {"none", "sound"} else _RARE


def nothing(system: SecondOrderSystem) -> Hypothesis:
    """No change."""
    return Hypothesis("none", "", (), np.zeros((system.p, 0)), np.zeros(0), "1")


def inexact(system: SecondOrderSystem, theta: Array) -> list[Hypothesis]:
    """The robot is healthy but its structure inexact, so that all of θ appears to change.

    An effect outside the span of W biases the parameters closest to it, by amounts that vary with
    the motion. Without this hypothesis, it would be attributed to the most similar single fault.
    """
    sizes = np.diag(KalmanFilter.sizes(theta, system.space.scale))
    none = nothing(system)
    return [
        none._replace(D=share * sizes, size=np.zeros(system.p), share=share) for share in _INEXACT
    ]


def restored(
    system: SecondOrderSystem, theta: Array, sound: Array, sign: Array, held: Array
) -> list[Hypothesis]:
    """Hypotheses that an actuator reported as reversed, broken or stuck works again.

    theta (p,) is θ̂ now, sound (p,) has the gains from before these actuators failed, sign (n_u,)
    is −1 for a reversed actuator, held (n_u,) the command of a stuck one, NaN for the others.
    """
    found = []
    scale = system.space.scale
    for command, k, part, names in _gains(system):
        if sign[command] == 1 and np.isnan(held[command]):
            continue
        D = np.eye(system.p)[:, k] * (_RESTORED * sound[k] / scale[k])
        mean = np.zeros(system.p)
        mean[k] = (sound[k] - theta[k]) / scale[k]
        size = np.zeros(len(k))
        found.append(Hypothesis("sound", part, names, D, size, "1", command, mean=mean))
    return found


def everything(system: SecondOrderSystem, theta: Array) -> Hypothesis:
    """All gains have changed independently."""
    k = system.space.actuators
    D = np.eye(system.p)[:, k] * (_GAIN * theta[k] / system.space.scale[k])
    return Hypothesis("several", "all actuators", _named(system, k), D, np.zeros(len(k)), "1")


def _named(system: SecondOrderSystem, k: Sequence[int] | Indices) -> tuple[str, ...]:
    return tuple(system.space.names[i] for i in k)


def _gains(system: SecondOrderSystem) -> Iterator[tuple[int, Indices, str, tuple[str, ...]]]:
    """Every actuator that has gains: its command; their indices, their part, and their names."""
    for command, k in enumerate(system.gains_by_command):
        if len(k):
            part = " and ".join(system.space.labels[i] for i in k)
            yield command, k, part, _named(system, k)


def _actuators(system: SecondOrderSystem, theta: Array) -> list[Hypothesis]:
    """Loss, reversal and seizure of every actuator that has a gain."""
    found = []
    scale = system.space.scale
    rng = np.random.default_rng(0)
    typical = np.sqrt(np.mean([system.random_state(rng)[2] ** 2 for _ in range(20)], axis=0))
    for command, k, part, names in _gains(system):
        D = np.zeros((system.p, 1 + (len(k) if len(k) > 1 else 0)))
        D[k, 0] = _GAIN * theta[k] / scale[k]
        if len(k) > 1:
            D[k, 1 + np.arange(len(k))] = _OWN * theta[k] / scale[k]
        size = D[k[0]] / (theta[k[0]] / scale[k[0]])  # relative change of the first gain
        found.append(Hypothesis("loss", part, names, D, -size, "1"))
        if _odd(system, command, k):
            found.append(Hypothesis("reversed", part, names, D, size, "1", command))
        none = np.zeros((system.p, 0))
        found.append(Hypothesis("broken", part, names, none, np.zeros(0), "1", command, 0.0))
        for held in (typical[command], -typical[command]):
            stuck = Hypothesis("stuck", part, names, D / _GAIN, size / _GAIN, "1", command, held)
            found.append(stuck._replace(curve=_curve(system, command, tuple(k), float(held))))
    return found


@lru_cache(maxsize=256)
def _curve(system: SecondOrderSystem, command: int, k: tuple[int, ...], typical: float) -> Array:
    """(2, N) sizes of a command with a typical one's sign, and its effort over that one's."""
    q, v, u = system.random_state(np.random.default_rng(0))
    sizes = np.linspace(0.0, 4.0, 401)
    t = np.zeros(len(sizes))
    q, v, u = (np.tile(part, (len(sizes), 1)) for part in (q, v, u))
    u[:, command] = sizes * typical
    efforts = np.abs(system.forces(t, q, v, u)[:, :, list(k)]).max(axis=(1, 2))
    rising = np.maximum.accumulate(efforts)
    return np.array([sizes * abs(typical), rising / rising[100]])


def _odd(system: SecondOrderSystem, command: int, k: Indices) -> bool:
    """Whether the force of gains k is odd in the command, so that −u equals a reversed gain."""
    q, v, u = system.random_state(np.random.default_rng(0))
    other = u.copy()
    x = np.concatenate([q, v])
    other[command] *= -1
    one, two = (system.F(0.0, x, c)[:, k] for c in (u, other))
    return bool(np.abs(one + two).max() <= 1e-9 * np.abs(one).max())


def _frictions(system: SecondOrderSystem) -> list[Hypothesis]:
    """Friction of each joint, or drag in each direction: all of its coefficients may change."""
    groups: dict[str, list[int]] = {}
    for block, place in system.space:
        word = next((w for w in _DISSIPATES if w in block.name), "")
        if not word or block.actuator:
            continue
        for label, i in zip(block.labels, range(place.start, place.stop), strict=True):
            _, _, where = label.partition(word)
            same = f"{word}{where}" if word in label else label
            groups.setdefault(same, []).append(i)
    found = []
    for part, k in groups.items():
        D = _FRICTION * np.eye(system.p)[:, k]
        unit = system.space.units[k[0]]
        scale = float(system.space.scale[k[0]])
        size = _FRICTION * scale * np.eye(len(k))[0]
        found.append(Hypothesis("friction", part, _named(system, k), D, size, unit))
    return found


def most_changed(space: ParameterSpace, friction: Hypothesis, jump: Jump) -> Hypothesis:
    """A change of friction or drag, reported as that of its most evident coefficient.

    It is `none` if not even all of them together have evidently changed. Others are returned as
    they are.
    """
    if friction.kind != "friction":
        return friction
    if not jump.evident:
        return friction._replace(kind="none")
    evident = np.abs(jump.delta) / np.sqrt(np.diag(jump.covariance))
    first = int(np.argmax(evident))
    order = [first, *(i for i in range(len(evident)) if i != first)]
    names = tuple(friction.names[i] for i in order)
    k = space.index(names[0])
    size = space.scale[k] * friction.D[k]
    unit = space.units[k]
    return friction._replace(names=names, part=space.labels[k], size=size, unit=unit)


def _payloads(system: SecondOrderSystem, theta: Array) -> list[Hypothesis]:
    """Payloads on the last body: its mass, first moments and, in air, second moments.

    A heavy payload multiplies the parameters of a light link. The filter would not converge from
    the link's own parameters, because a step is at most a share of these. Trials of heavy payloads
    therefore start with a ball of typical mass at the joint.
    """
    space = system.space
    masses = system.point_masses
    name = masses.carrier
    bodies = {block.name: place for block, place in space if block.geometry == "pseudo_inertia"}
    if name not in bodies:
        return [_submerged_payload(system)] if masses.submerged else []
    place = bodies[name]
    whole = sum(float(space.scale[at][0]) for at in bodies.values())
    scale = space.scale[place]
    D = np.zeros((system.p, 10))
    mass = max(_BODY * scale[0], _LOAD * whole)
    length = scale[1] / scale[0]
    D[place] = np.diag(mass * np.r_[1.0, [length] * 3, [length**2] * 6] / scale)
    size = mass * np.eye(10)[0]
    names = tuple(space.names[place])
    found = [Hypothesis("payload", f"mass of {name}", names, D, size, "kg")]
    for mass in whole * np.array(_LOADS):
        mean = np.zeros(system.p)  # of the ball's radius
        square = (mass / _DENSITY) ** (2 / 3)
        mean[place] = mass * np.r_[1.0, np.zeros(3), square * np.array([1, 0, 1, 0, 0, 1])]
        found.append(loaded(found[0], Cone.of(space), space.scale, theta, mean / space.scale))
    return found


def _submerged_payload(system: SecondOrderSystem) -> Hypothesis:
    """A payload on a body in water."""
    space = system.space
    mass = float(space.scale[space["mass matrix"]][0])
    masses = system.point_masses
    own = masses.change(mass, np.zeros(3))
    reach = 0.3
    arms = [masses.change(mass, reach * e) - own for e in np.eye(3)]
    rows, columns = np.triu_indices(6)
    turning = space["mass matrix"].start + np.flatnonzero((rows >= 3) & (columns >= 3))
    moments = [mass * reach**2 * np.eye(len(space))[i] for i in turning]
    D = _BODY * np.stack([own, *arms, *moments], axis=1) / space.scale[:, None]
    names = tuple(space.names[i] for i in np.flatnonzero(np.abs(D).any(axis=1)))
    size = _BODY * mass * np.eye(10)[0]
    return Hypothesis("payload", "mass of the body", names, D, size, "kg")


def loaded(load: Hypothesis, cone: Cone, scale: Array, theta: Array, mean: Array) -> Hypothesis:
    """A load whose jump of θ/scale is about `mean` (p,), free within the cone of physical θ.

    Raises:
        LinAlgError: θ with the load is not inside the cone, or too close to its boundary.
    """
    place = np.flatnonzero(mean)
    first = place[0]
    last = place[-1] + 1
    _, metric = cone.derivatives(theta + scale * mean)
    units = np.outer(scale, scale)[first:last, first:last]
    root = np.linalg.cholesky(metric[first:last, first:last] * units)
    D = np.zeros((len(theta), last - first))
    D[first:last] = _LOADED * np.linalg.inv(root).T  # D Dᵀ is the inverse of the metric
    mass = scale[first]
    return load._replace(mean=mean, offset=float(mass * mean[first]), D=D, size=mass * D[first])


def _biases(system: SecondOrderSystem) -> list[Hypothesis]:
    """A constant error of every sensor."""
    n = system.n
    found = []
    none = np.zeros((system.p, 0))
    for i, (label, unit) in enumerate(system.sensors):
        name = f"{'position' if i < n else 'velocity'} {1 + i % n}"  # as faults are written
        found.append(Hypothesis("bias", label, (name,), none, np.zeros(0), unit, channel=i))
    return found
