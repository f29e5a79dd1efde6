"""What the rows of a tree of joints might lack: columns that its residuals are compared with.

Each suspect is an effect outside the structure, as the column by which it would change the balance:
a mount that is not level, an encoder's zero or ratio, a lag, friction of another shape, a coupling.
Effects of the kinematics are linearised at the estimate, by the derivatives of inverse dynamics
(Carpentier and Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS 2018).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..parameters import Array
from ..systems.optional import pin
from .joints import SPEEDS, Choice, JointRows
from .links import positions, weight_of
from .problem import Problem
from .residuals import Suspect
from .smoothing import Smooth


def arm_suspects(rows: JointRows, choice: Choice, problem: Problem, theta: Array) -> list[Suspect]:
    """Suspects of a tree of joints.

    Args:
        rows: of the training log.
        choice: the structure of the fit.
        problem: the fit.
        theta: (p,) θ̂, links first.
    """
    model = pin.Model(rows.robot.model)
    for i in range(1, model.njoints):
        phi = theta[10 * i - 10 : 10 * i]
        model.inertias[i] = pin.Inertia.FromDynamicParameters(phi)
    force = problem.residual(theta) - problem.actuation(theta)
    return [*_kinematic(rows, model), *_lags(rows, force), *_own(rows, choice, force)]


def _kinematic(rows: JointRows, model: pin.Model) -> Iterator[Suspect]:
    """A mount that is not level; zero and ratio of every joint's encoder."""
    names, down = rows.robot.joints, model.gravity.linear.copy()
    if np.linalg.norm(down) > 0:
        across = np.linalg.svd(down[None])[2][1:] * np.linalg.norm(down)
        weights = [_weight(model, gravity) for gravity in across]
        columns = np.stack([rows.joined(lambda m, w=w: w(m.q)) for w in weights], 2)
        yield Suspect(
            "a weight across the mount's vertical",
            "",
            columns,
            "Check how the base is mounted: the model's gravity should be as many degrees off.",
        )
    slopes = rows.joined(lambda m: _slopes(model, m))
    for j, name in enumerate(names):
        yield Suspect(
            "a shift of its position",
            name,
            slopes[:, 0, :, j, None],
            "Check the encoder's zero against the model's.",
        )
        yield Suspect(
            "a scale of its position",
            name,
            slopes[:, 1, :, j, None],
            "Check the gear ratio and the unit of its position in the map.",
        )


def _weight(model: pin.Model, gravity: Array) -> Callable[[Array], Array]:
    """Function of coordinates: torques of the links' weight under another gravity (3,)."""
    own = pin.Model(model)
    own.gravity = pin.Motion(gravity, np.zeros(3))
    return weight_of(own, None)


def _slopes(model: pin.Model, motion: Smooth) -> Array:
    """(N, 2, n, n) changes of all joints' torques with each joint's zero and relative scale."""
    data, n = model.createData(), model.nv
    found = np.empty((len(motion.t), 2, n, n))
    for k, q in enumerate(positions(model, motion.q)):
        v, a = motion.v[k], motion.a[k]
        by_q, by_v, by_a = pin.computeRNEADerivatives(model, data, q, v, a)
        found[k, 0] = by_q
        found[k, 1] = by_q * motion.q[k] + by_v * v + by_a * a
    return found


def _lags(rows: JointRows, force: Array) -> Iterator[Suspect]:
    """First and second derivatives of the forces: of all together, and of each.

    Those of the recorded commands would not do: a command contains the residual.
    """
    rates = np.empty((*force.shape, 2))
    for number in np.unique(rows.segment):
        own = rows.segment == number
        rate = force[own]
        for order in (0, 1):
            rate = np.gradient(rate, rows.t[own], axis=0) if own.sum() > 2 else 0 * rate
            rates[own, :, order] = rate
    remedy = (
        "Its force lags behind the recorded command: record the measured current instead of the "
        "commanded one, or give each command's delay."
    )
    yield Suspect("the rate of all forces", "", rates, remedy)
    for j, name in enumerate(rows.robot.joints):
        yield Suspect("the rate of its force", name, _on(j, force.shape[1], rates[:, j]), remedy)


def _own(rows: JointRows, choice: Choice, force: Array) -> Iterator[Suspect]:
    """Shapes of friction, position, force and the neighbours' motion, on each joint's row."""
    n, names = len(rows.robot.joints), rows.robot.joints
    a, v = rows.diagonal["rotor"], rows.diagonal["viscous"]
    coupled = [{i, j} for i, j, _ in choice.coupled]
    angle = rows.joined(lambda m: np.stack([np.sin(m.q), np.cos(m.q), m.q], axis=2))
    curve = rows.diagonal["coulomb"]
    for j, name in enumerate(names):
        own = {
            "a constant": (np.ones((len(v), 1)), "Name the column `offset`."),
            "its position": (
                angle[:, j],
                "A spring, a counterweight or a cable pulls at it, or its axis is not the model's.",
            ),
            "its acceleration": (a[:, [j]], "Check its rotor inertia and the delay."),
            "its velocity": (
                np.column_stack([v[:, j], rows.diagonal["quadratic"][:, j],
                                 rows.diagonal["cubic"][:, j]]),
                "Its friction curve is another: name the columns `quadratic` and `cubic`.",
            ),
            "its direction": (
                curve[:, :, j].T,
                f"Its dry friction is no tanh(v/s) with s of {SPEEDS[0]:g} to {SPEEDS[-1]:g}: "
                "leave out slow motion (`rest` in the map).",
            ),
            "its load": (
                rows.diagonal["load"][choice.speed[j]][:, [j]],
                "Its friction grows with the load: name the column `load`.",
            ),
            "the size of its force": (
                (force * np.abs(force))[:, [j]],
                "Its force is no multiple of the command: check saturation and torque ripple.",
            ),
        }  # fmt: skip
        for i in (j - 1, j + 1):
            if 0 <= i < n and {i, j} not in coupled:
                motion = np.column_stack([a[:, i], v[:, i], curve[1, :, i]])
                own[f"the motion of {names[i]}"] = motion, "Name the coupling of both in the map."
        for words, (columns, remedy) in own.items():
            yield Suspect(words, name, _on(j, n, columns), remedy)


def _on(joint: int, n: int, columns: Array) -> Array:
    """(N, n, c) columns (N, c) on the row of one joint."""
    found = np.zeros((len(columns), n, columns.shape[1]))
    found[:, joint] = columns
    return found
