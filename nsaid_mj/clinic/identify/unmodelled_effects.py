"""Unmodelled effects of a tree of joints, as columns against which residuals are tested.

Each suspect is an unmodelled effect, given by the column that it adds to the force balance: a mount
that is not level, an encoder's zero or ratio, a lag, friction of another shape, a coupling. Effects
of the kinematics are linearised at the estimate, by the derivatives of inverse dynamics (Carpentier
and Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS 2018).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...base import pin
from ...core import Array, kernel
from ...robots import with_inertias
from .choose.columns import BROAD, SPEEDS, Choice
from .joints import JointRows
from .links import weight_of
from .problem import FitProblem
from .residuals import Suspect
from .smoothing import Smooth

MOST = {  # of hinges [rad] and slides [m], or [s]: what is larger is something else
    "twist": (np.deg2rad(5.0), 5e-3),  # between encoder and link; stiff gears twist by 0.1°
    "backlash": (np.deg2rad(3.0), 3e-3),  # worn hobby servos have 1°
    "zero": (np.deg2rad(45.0), 0.1),  # of an encoder
    "lag": (0.2, 0.2),  # of a drive's force
}
UNITS = ("mrad", "mm")
_LARGEST = 0.99  # quantile of a joint's torques
_SMALL = 0.1  # of the rms force: below it the inverse force of a dead zone stays constant
_REVERSES = 0.01  # share of rows in which a force is reversed, from which it has two directions
PLAYS = (0.002, 0.006, 0.02)  # of gears [rad or m], with which free links are simulated
_APART = 3.0  # size found over the simulated one: how often and how fast a link crosses its play
# depends on the play, so that a column says nothing of quite another one


def arm_suspects(
    rows: JointRows, choice: Choice, problem: FitProblem, theta: Array
) -> Iterator[Suspect]:
    """Suspects of a tree of joints, at θ̂ (p,), links first, of the fit with structure `choice`.

    Those of the kinematics come last: a mount that is not level; zero and ratio of every joint's
    encoder; its gear's compliance and play.
    """
    links = theta[: rows.links.shape[2]]
    rotor = np.zeros(len(rows.robot.joints))
    model = with_inertias(rows.robot.model, links, 0 * rotor)  # rotors are columns of their own
    residual = problem.residual(theta)
    driven = -problem.actuation(theta)
    needed = {s.cause: s.columns for s in _of_forces(rows, driven + residual)}
    residual = np.where(problem.usable, residual, 0.0)
    for j, columns in enumerate(choice.columns):
        if "rotor" in columns:
            rotor[j] = theta[problem.space.index(f"rotor_{j + 1}")]
    for stated in _of_forces(rows, driven):
        if stated.cause in needed:  # else the force is reversed with the residual alone, or without
            yield stated._replace(other=needed[stated.cause])
    yield from _own(rows, choice)
    torque = rows.links @ links
    names = rows.robot.joints
    at = rows.robot.system.position
    down = model.gravity.linear.copy()
    if np.linalg.norm(down) > 0:
        columns = []
        for gravity in np.linalg.svd(down[None])[2][1:] * np.linalg.norm(down):
            tilted = pin.Model(model)
            tilted.gravity = pin.Motion(gravity, np.zeros(3))
            columns.append(rows.joined(lambda m, model=tilted: weight_of(model, at(m.q))))
        remedy = "Check how the base is mounted; if it is tilted, tilt the model's gravity."
        yield Suspect("gravity across the model's vertical", "", np.stack(columns, 2), remedy)
    parts = [[rows.chosen.rows(x) for x in _changes(model, at(m.q), m)] for m in rows.motions]
    found = [np.concatenate(kind) for kind in zip(*parts, strict=True)]
    twists = _rates(rows, torque)
    answered = _answered(rows, model, rotor, residual)
    for j, name in enumerate(names):
        kind = int(rows.robot.system.slides[j])
        zero, by_v, by_a, scale, *plays = (change[:, :, j, None] for change in found)
        remedy = "Check the encoder's zero against the model's."
        yield Suspect("an offset of its position", name, zero, remedy, most=MOST["zero"][kind])
        remedy = "Check the gear ratio and the unit of its position in the map."
        driven = scale - answered[:, :, j, None]
        yield Suspect("a scale error of its position", name, scale, remedy, other=driven)
        first, second = twists[:, j, :, None, None].swapaxes(0, 1)
        behind = -(torque[:, j, None, None] * zero + first * by_v + second * by_a)
        remedy = "Its gear, belt or shaft yields: identify from slower motion."
        largest = float(np.quantile(np.abs(torque[:, j]), _LARGEST))
        for columns in (behind, _on(j, len(names), rotor[j] * second[:, :, 0])):
            yield Suspect(
                "the twist of an elastic joint",
                name,
                columns,
                remedy,
                lambda x, load=largest, kind=kind: _yielding(x, load, kind),
                most=MOST["twist"][kind] / max(largest, 1e-300),
                part="gear",
            )
        remedy = "Its gear has play: tighten it, or keep its load to one side."
        for play, columns in zip(PLAYS, plays, strict=True):
            yield Suspect(
                "backlash",
                name,
                columns,
                remedy,
                lambda x, play=play, kind=kind: f"about {1e3 * x * play:.2g} {UNITS[kind]}",
                most=min(MOST["backlash"][kind] / play, _APART),
                least=0.0 if play == PLAYS[0] else 1 / _APART,
                part="gear",
            )


def _yielding(compliance: float, load: float, kind: int) -> str:
    """Stiffness of a hinge or slide, and the twist at the log's largest loads [N·m or N]."""
    stiffness = 1 / max(compliance, 1e-300)
    twist = compliance * load
    if kind:
        return f"about {stiffness:.2g} N/m, which yields by {1e3 * twist:.2g} mm in this log"
    return f"about {stiffness:.2g} N·m/rad, a twist of {np.rad2deg(twist):.2g}° in this log"


def _of_forces(rows: JointRows, force: Array) -> Iterator[Suspect]:
    """Effects on forces (N, n); lags as first and second derivatives, of all together and each."""
    rates = _rates(rows, force)
    remedy = (
        "Its force lags behind the recorded command: record the measured current instead of the "
        "commanded one, or give each command's delay."
    )
    most = MOST["lag"][0]
    yield Suspect("the rate of all forces", "", rates, remedy, most=most)
    for j, name in enumerate(rows.robot.joints):
        own = _on(j, force.shape[1], rates[:, j])
        yield Suspect("the rate of its force", name, own, remedy, most=most)
    each = force[:, :, None] * np.eye(force.shape[1])
    yield from command_suspects(rows.t, each, rows.robot.joints)


def command_suspects(t: Array, forces: Array, names: Sequence[str]) -> Iterator[Suspect]:
    """Forces (N, n, k) not proportional to a command: asymmetric, curved, with a dead zone, fading.

    t (N,) is in s.
    """
    late = ((t - t.mean()) / max(float(np.ptp(t)), 1e-300))[:, None]
    fading = (
        "The gain changes in time, as with the supply's voltage: identify shorter logs, or give a "
    )
    fading += "vehicle's voltage in [battery] of the map."
    yield Suspect("all forces times the time", "", (forces.sum(axis=2) * late)[:, :, None], fading)
    for k, name in enumerate(names):
        own = forces[:, :, k]
        signed = own @ np.linalg.svd(own.T @ own)[0][:, 0]
        size = np.abs(signed) / max(float(np.sqrt(np.mean(signed**2))), 1e-300)
        reversing = []
        if min(np.mean(signed > 0), np.mean(signed < 0)) > _REVERSES:  # else it is its own column
            weaker = "Its drive is weaker in one direction."
            reversing = [("the sign of its force", np.sign(signed), weaker)]
        for words, factor, more in (
            *reversing,
            ("the size of its force", size, "It may saturate."),
            ("a dead zone of its force", 1 / np.maximum(size, _SMALL), "It may have a dead zone."),
        ):
            remedy = f"Its force is not proportional to the command. {more}"
            yield Suspect(words, name, (own * factor[:, None])[:, :, None], remedy)
        yield Suspect("its force times the time", name, (own * late)[:, :, None], fading)


def _changes(model: pin.Model, positions: Array, motion: Smooth) -> Iterator[Array]:
    """(N, n, n) changes of all joints' torques with each joint's motion, one kind after the other.

    The derivatives by position, velocity and acceleration, the change by a relative scale of the
    position, and that by each of `PLAYS` behind an encoder on the motor's side. `model` has the
    estimated links; positions (N, m) are Pinocchio's. One by one, as together they would need
    several times the memory of a long log.
    """
    data = model.createData()
    n = model.nv
    slopes = np.empty((len(motion.t), 3, n, n))
    torques = np.empty((len(motion.t), n))
    for k, q in enumerate(positions):
        slopes[k] = pin.computeRNEADerivatives(model, data, q, motion.v[k], motion.a[k])
        torques[k] = data.tau
    yield from slopes.swapaxes(0, 1)
    yield _moved(slopes, (motion.q, motion.v, motion.a))
    own = np.diagonal(slopes[:, 2], axis1=1, axis2=2)
    needed = torques / np.maximum(own, 1e-12)  # of no mass
    for play in PLAYS:
        twist = _between_flanks(motion.t, needed, play)
        twist -= twist.mean(axis=0)  # a link that stays on one side has another zero, no play
        rate = np.gradient(twist, motion.t, axis=0)
        yield -_moved(slopes, (twist, rate, np.gradient(rate, motion.t, axis=0)))


def _moved(slopes: Array, motion: tuple[Array, Array, Array]) -> Array:
    """(N, n, n) changes of torques as each joint alone moves by q, v, a (N, n) more."""
    changes = np.zeros((len(slopes), *slopes.shape[2:]))
    for k, part in enumerate(motion):
        changes += slopes[:, k] * part[:, None, :]
    return changes


@kernel()
def _between_flanks(t, needed, play):
    """(N, n) distances of links behind their motors, in gears with play (rad or m), no rebound.

    needed (N, n) is the torque of the rigid joint over the link's inertia [1/s²], at t (N,) [s].
    """
    behind = np.zeros(needed.shape)
    for j in range(needed.shape[1]):
        x = 0.5 * play * np.sign(needed[0, j])
        rate = 0.0
        for k in range(len(t)):
            h = t[k] - t[max(k - 1, 0)]
            rate += h * needed[k, j]
            x += h * rate
            if abs(x) >= 0.5 * play:
                x = 0.5 * play * np.sign(x)
                rate = 0.0
            behind[k, j] = x
    return behind


def _answered(rows: JointRows, model: pin.Model, rotor: Array, residual: Array) -> Array:
    """(N, n, n) the acceleration's part in a scale error that the commands do not explain.

    `model` has the estimated links; rotor (n,) are inertias, residual (N, n) the inverse dynamics
    minus the forces of the commands.
    """
    data = model.createData()
    found = np.empty((*residual.shape, model.nv))
    for k, q in enumerate(rows.robot.system.position(rows.joined(lambda m: m.q))):
        upper = np.triu(pin.crba(model, data, q))
        inertia = upper + np.triu(upper, 1).T
        found[k] = inertia * np.linalg.solve(inertia + np.diag(rotor), residual[k])
    return found


def _rates(rows: JointRows, x: Array) -> Array:
    """(N, n, 2) first and second derivatives of x (N, n) along the segments."""
    rates = np.empty((*x.shape, 2))
    for number in np.unique(rows.segment):
        own = rows.segment == number
        rate = x[own]
        for order in (0, 1):
            rate = np.gradient(rate, rows.t[own], axis=0) if own.sum() > 2 else 0 * rate
            rates[own, :, order] = rate
    return rates


def _own(rows: JointRows, choice: Choice) -> Iterator[Suspect]:
    """Shapes of friction, position and the neighbours' motion, on each joint's row."""
    n = len(rows.robot.joints)
    names = rows.robot.joints
    a = rows.diagonal["rotor"]
    v = rows.diagonal["viscous"]
    coupled = [{i, j} for i, j, _ in choice.coupled]
    angle = rows.joined(lambda m: np.stack([np.sin(m.q), np.cos(m.q), m.q], axis=2))
    curve = rows.diagonal["coulomb"]
    for j, name in enumerate(names):
        own = {
            "a constant": (np.ones((len(v), 1)), "Add the column `offset`."),
            "its position": (
                angle[:, j],
                "A counterweight or a cable pulls at it, or its axis is not the model's: try the "
                "column `spring`.",
            ),
            "its acceleration": (a[:, [j]], "Check its rotor inertia and the delay."),
            "its velocity": (
                np.column_stack(
                    [v[:, j], rows.diagonal["quadratic"][:, j], rows.diagonal["cubic"][:, j]]
                ),
                "Its friction curve differs: add the columns `quadratic`, `cubic`, `stribeck`.",
            ),
            "its direction": (
                curve[:, :, j].T,
                f"Its dry friction is not tanh(v/s) with s of {SPEEDS[0]:g} to {SPEEDS[-1]:g}: "
                "leave out slow motion (`rest` in the map).",
            ),
            "its load": (
                rows.diagonal["load"][choice.speed[j]][:, [j]],
                "Its friction grows with the load: rerun with `--columns load`.",
            ),
        }
        for i in (j - 1, j + 1):
            if 0 <= i < n and {i, j} not in coupled:
                motion = np.column_stack([a[:, i], v[:, i], curve[BROAD, :, i]])
                own[f"the motion of {names[i]}"] = motion, "Name the coupling of both in the map."
        for words, (columns, remedy) in own.items():
            yield Suspect(words, name, _on(j, n, columns), remedy)


def _on(joint: int, n: int, columns: Array) -> Array:
    """(N, n, c) columns (N, c) on the row of one joint."""
    found = np.zeros((len(columns), n, columns.shape[1]))
    found[:, joint] = columns
    return found
