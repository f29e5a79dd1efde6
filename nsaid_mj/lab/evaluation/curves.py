"""What is drawn of a run, as data: curves over time, and predicted and measured forces.

Page and recording draw the same panels; those that are no part of a page are marked.
"""

from dataclasses import replace

import numpy as np

from ...core import (
    Array,
    Indices,
    JointTree,
    ParameterSpace,
    SecondOrderSystem,
)
from ...report import (
    COLOURS,
    LAWS,
    Comparison,
    Panel,
    percent,
    spread,
)
from ..contacts import contact_forces, without_contacts
from ..loop import Run
from .confidence import INTERVAL
from .figures import common_factor, forces_of, midpoints
from .labels import EXCITATION_LEVELS, groups
from .lyapunov import energy as energy_of
from .run_result import OWN, RunResult
from .truth import CONVERGED, Truth

_POINTS = 4000  # of a curve over time, at most; more than the width of a screen
_NUMBERS = 400_000  # entries of θ̂ over all curves, at most: a minute's recording stays below 20 MB
_FORCE_POINTS = 600  # of a curve of forces
_VANISHED = 1e-3  # share of the largest force below which a row without contacts holds no balance
_TAIL = 0.9  # share of the run after which the stated intervals are drawn
_LARGEST_SPACE = 12  # parameters whose ratios to the truth are drawn together, at most


def with_curves(result: RunResult, run: Run, truth: Truth | None) -> RunResult:
    """A run's result with its curves: over time, then the forces along every velocity.

    The first ones carry the verdict. Those that compare with the truth are left out if it is None.
    """
    most = min(_POINTS, max(1000, _NUMBERS // run.system.p))
    rows = spread(len(run.record), most)
    panels = [
        *_main(result, run, rows, truth),
        *_motion(run, rows),
        *_estimates(result, run, rows, truth),
        *_conserved(run, rows),
        *_contacts(run, rows, truth),
    ]
    if truth is None:
        panels += _predictions(run, rows)
    else:
        panels += _errors(result, run, rows, truth)
    shown = tuple(panel for panel in panels if panel.curves)
    return replace(result, curves=(*shown, *_forces(run, truth)))


def _main(result: RunResult, run: Run, rows: Indices, truth: Truth | None) -> list[Panel]:
    """The panels of the run's page; the first carries the verdict."""
    record = run.record
    t = record["t"][rows]
    later = np.arange(1, len(record))
    distance = Panel(
        "Distance to the true set",
        "‖P⊥ᵀ θ̂‖ / ‖θ̂‖, of θ/scale [–]",
        logarithmic=True,
        level=CONVERGED,
        level_name=f"converged: within {100 * CONVERGED:g} %",
        key=("distance",),
    )
    units = ", ".join(dict.fromkeys(run.system.velocity_units))
    error = Panel(
        "Velocity error, rms over short intervals",
        f"rms Δv [{units}]",
        logarithmic=True,
        key=("velocity_rms",),
    )
    for k, (name, label) in enumerate(_identifiers(run)):
        suffix = f"_{name}" if name else ""
        place = _place(result, name, k)
        if truth is not None:
            ratio = truth.distance(t, record.rows(f"theta_hat{suffix}", rows))
            distance.add(t, ratio, label, place=place, part=(label,))
        if len(later):
            dv = record[f"v_hat{suffix}"][later] - record["v"][later]
            error.add_rms(record["t"][later], dv, label, place, part=(label,))
    gains = _gains(result, run, rows, None if truth is None else truth.theta_at(t))
    energy = Panel("Lyapunov function", "V [J]", logarithmic=True, key=("lyapunov",))
    if truth is not None and run.identifiers[""].metric is not None:
        energy.add(t, energy_of(run, truth, rows), "V of (66)")
    limbs = _limbs(run, rows, None if truth is None else truth.theta_at(t))
    panels = [distance, gains, limbs, error, energy] if truth is not None else [error, gains, limbs]
    found = [fault.found for fault in run.faults]
    return [replace(panel, events=found, event_name="fault found") for panel in panels]


def _identifiers(run: Run) -> list[tuple[str, str]]:
    """Names and labels of the identifiers, the scenario's own first."""
    return [("", OWN), *((name, name) for name in run.record.rivals)]


def _place(result: RunResult, name: str, k: int) -> int:
    """Place of the colour of the run's law, whose name is empty, or of its k-th identifier."""
    return LAWS.get(name or result.law.law, k % len(COLOURS))


def _gains(result: RunResult, run: Run, rows: Indices, true: Array | None) -> Panel:
    """Actuator parameters relative to the true ones, or to the prior if the truth is unknown.

    The intervals that the law states at the end are drawn over the last tenth.
    """
    space = run.system.space
    t = run.record["t"][rows]
    k = space.actuators
    theta_hat = run.record.rows("theta_hat", rows)
    ratio = theta_hat[:, k] / (theta_hat[:1, k] if true is None else true[:, k])
    over = "k̂/k̂(0)" if true is None else "k̂/k"
    title = "Actuators relative to the " + ("prior" if true is None else "truth (1 is exact)")
    panel = Panel(
        title,
        f"{over}, relative to the mean [–]",
        level=1.0,
        band_name="95 % interval, as stated at the end",
        key=() if len(k) < 2 else ("gains_over_prior",) if true is None else ("share",),
    )
    stated = {} if result.confidence is None else result.confidence.actuators
    end = t >= t[0] + _TAIL * (t[-1] - t[0])
    for i, share in zip(k, (ratio / ratio.mean(axis=1, keepdims=True)).T, strict=True):
        band = None
        deviation = stated.get(space.names[i])
        if deviation is not None and len(k) > 1:
            half = INTERVAL * deviation * share[-1]
            band = np.where(end, share[-1] - half, np.nan), np.where(end, share[-1] + half, np.nan)
        panel.add(t, share, space.labels[i], band)
    return panel


def _limbs(run: Run, rows: Indices, true: Array | None) -> Panel:
    """The scale of each limb: the mean of its gains relative to the true or prior ones.

    On a stand every limb has a scale of its own, which no motion reveals; on the ground they have
    one. Empty for a robot with fewer than two limbs with motors.
    """
    system = run.system
    panel = Panel(
        "Scale of each limb",
        "mean k̂/k, relative to that of all [–]",
        level=1.0,
        key=("limbs",),
    )
    limbs = gains_of_limbs(system)
    if len(limbs) < 2:
        return panel
    k = system.space.actuators
    theta_hat = run.record.rows("theta_hat", rows)[:, k]
    ratio = theta_hat / (theta_hat[:1] if true is None else true[:, k])
    for name, own in limbs.items():
        panel.add(run.record["t"][rows], ratio[:, own].mean(axis=1) / ratio.mean(axis=1), name)
    return panel


def gains_of_limbs(system: SecondOrderSystem) -> dict[str, Indices]:
    """The gains of each limb, as places in `space.actuators`, by the name of its first link."""
    if not isinstance(system, JointTree):
        return {}
    bodies = system.structure.bodies
    root = 0 if system.group else -1
    limbs: dict[str, list[int]] = {}
    for place, joint in enumerate(system.driven):
        body = joint + (1 if system.group else 0)
        while bodies[body].parent != root:
            body = bodies[body].parent
        limbs.setdefault(bodies[body].name, []).append(place)
    return {name: np.array(own) for name, own in limbs.items()}


def _contacts(run: Run, rows: Indices, truth: Truth | None) -> list[Panel]:
    """The upward force on every foot that θ̂ implies and, if it is known, that under the true θ."""
    system = run.system
    contacts = system.structure.contacts
    log = run.record.log
    if not contacts or len(log.t) < 2:
        return []
    panel = _recorded("contact", "Upward forces on the feet, implied by the motion", "force [N]")
    names = [contact.name for contact in contacts]
    theta_hat = run.record.rows("theta_hat", rows)
    if truth is not None:
        true = truth.theta_at(log.t[rows])
        scale = system.space.scale
        theta_hat = (
            theta_hat * common_factor(theta_hat, true, scale, system.space.actuators)[:, None]
        )
        under = contact_forces(system, log, rows, true).upwards
        panel.add_columns(log.t[rows], under, names, ("true",), pale=True)
    implied = contact_forces(system, log, rows, theta_hat).upwards
    panel.add_columns(log.t[rows], implied, names, ("implied",))
    return [panel]


def _recorded(key: str, title: str, label: str, logarithmic: bool = False) -> Panel:
    """A panel of recordings, which pages leave out."""
    return Panel(title, label, logarithmic, key=(key,), page=False)


def _motion(run: Run, rows: Indices) -> list[Panel]:
    """Velocities, their errors, commands, and levels of excitation."""
    record = run.record
    system = run.system
    t = record["t"][rows]
    v = record["v"][rows]
    units = ", ".join(dict.fromkeys(system.velocity_units))
    error = _recorded("velocity_error", "Velocity error Δv: predicted − measured", f"Δv [{units}]")
    error.add_columns(t, record["v_hat"][rows] - v, [f"Δ{name}" for name in system.velocity_names])
    velocity = _recorded("velocity", "Measured velocity", f"v [{units}]")
    velocity.add_columns(t, v, system.velocity_names, ("measured",))
    command = _recorded("command", "Command", "u [–]")
    command.add_columns(t, record["u"][rows], system.command_names)
    excitation = _recorded("excitation", "Persistence of excitation over a window", "ε₀ [N·m·s]")
    every, observable = EXCITATION_LEVELS
    excitation.add(t, record["pe"][rows], every, part=("all",))
    excitation.add(t, record["pe_perp"][rows], observable, part=("perpendicular",))
    excitation.curves = [replace(curve, steps=True) for curve in excitation.curves]
    return [error, velocity, command, excitation]


def _estimates(result: RunResult, run: Run, rows: Indices, truth: Truth | None) -> list[Panel]:
    """θ̂ by block and unit and, if the truth is known, the true θ at the same common scale.

    The 95 % intervals of the actuators that the law states at the end are drawn over the last tenth
    of the run.
    """
    space = run.system.space
    theta_hat = run.record.rows("theta_hat", rows)
    t = run.record["t"][rows]
    true = None
    if truth is not None:
        true = truth.theta_at(t)
        true = true / common_factor(theta_hat, true, space.scale, space.actuators)[:, None]
    last = t >= t[0] + _TAIL * (t[-1] - t[0])
    stated = {} if result.confidence is None else result.confidence.actuators
    panels = []
    for group in groups(space):
        panel = Panel(f"Estimate of {group.title}", group.title, key=group.key, page=False)
        deviations = [stated.get(space.names[k]) for k in group.indices]
        known = all(deviation is not None for deviation in deviations)
        for k, name, deviation in zip(group.indices, group.names, deviations, strict=True):
            band = None
            if known and deviation is not None:
                value = theta_hat[-1, k]
                half = INTERVAL * deviation
                low = np.where(last, value * (1 - half), np.nan)
                band = low, np.where(last, value * (1 + half), np.nan)
            panel.add(t, theta_hat[:, k], name, band, part=("estimated",))
        if true is not None:
            names = ["true direction"] * len(group.indices)
            panel.add_columns(t, true[:, group.indices], names, ("true_direction",), pale=True)
        panels.append(panel)
    return panels


def _conserved(run: Run, rows: Indices) -> list[Panel]:
    """Relative drift of θ̂ᵀ Γ⁻¹ θ̂, which the law conserves; empty if it does not."""
    record = run.record
    identifier = run.identifiers[""]
    if not identifier.conserves:
        return []
    now = identifier.conserved(record.rows("theta_hat", rows)) + record["spent"][rows]
    drift = now / float(identifier.conserved(record.rows("theta_hat", 0))) - 1
    size = np.abs(drift) if drift.any() else np.full(len(drift), np.finfo(float).eps)
    panel = _recorded(
        "conserved", "Relative drift of the conserved quantity (30)", "drift [–]", logarithmic=True
    )
    panel.add(record["t"][rows], size, "drift of the conserved quantity")
    return [panel]


def _predictions(run: Run, rows: Indices) -> list[Panel]:
    """Predicted velocities v̂, and the two sides of the force balance at the estimate.

    The force balance W(t, x, v, v̇) θ̂ = 0 uses the measured v̇: on one side the forces that the
    motion requires, on the other those of the actuators. It needs the command of every time step
    and is left out if the record skips rows.
    """
    record = run.record
    system = run.system
    t = run.record["t"][rows]
    units = ", ".join(dict.fromkeys(system.velocity_units))
    predicted = _recorded("velocity", "Predicted velocity", f"v̂ [{units}]")
    names = system.velocity_names
    predicted.add_columns(t, record["v_hat"][rows], names, ("predicted",), pale=True)
    if run.scenario.record_every > 1 or len(record) < 2:
        return [predicted]
    log = record.log  # the last row has no successor
    first = np.minimum(rows, len(record) - 2)
    parts = [midpoints(log.part(k, k + 2), system, 1) for k in first]
    times, x, v, u, a = (np.concatenate(part) for part in zip(*parts, strict=True))
    W = without_contacts(system, x[:, : log.q.shape[1]], system.regressor(times, x, v, a, u))
    terms = W * record.rows("theta_hat", first)[:, None]
    given = terms[..., system.space.actuators].sum(axis=-1)
    labels = zip(system.velocity_labels, system.force_units, strict=True)
    names = [f"{label} [{unit}]" for label, unit in labels]
    force = _recorded("force", "Forces that the motion needs and actuator forces", "force [SI]")
    needed = [f"motion {name}" for name in names]
    force.add_columns(t, terms.sum(axis=-1) - given, needed, ("motion",))
    exerted = [f"actuators {name}" for name in names]
    force.add_columns(t, -given, exerted, ("actuators",), pale=True)
    return [predicted, force]


def shared(space: ParameterSpace, r: int, truth: Array) -> Indices:
    """Indices of the parameters whose ratios to the truth are shown relative to their mean.

    These are the actuators if there are several. With a single actuator they are all parameters,
    provided that the common scale is the only unobservable direction and no true value is zero;
    otherwise there are none.
    """
    if len(space.actuators) > 1:
        return space.actuators.astype(np.intp)
    whole = r == 1 and len(space) <= _LARGEST_SPACE and np.abs(truth).min() > 0
    return np.arange(len(space)) if whole else np.zeros(0, dtype=np.intp)


def _errors(result: RunResult, run: Run, rows: Indices, truth: Truth) -> list[Panel]:
    """Errors along observable directions, and those of ratios of parameters."""
    nullspace = truth.nullspace
    record = run.record
    space = run.system.space
    t = run.record["t"][rows]
    theta_hat = record.rows("theta_hat", rows)
    true = truth.theta_at(t)
    components = [f"direction {i} [–]" for i in range(1, nullspace.P_perp.shape[1] + 1)]
    along = _recorded(
        "theta_perp", "Components of the error along observable directions", "P⊥ᵀ θ̂ [–]"
    )
    along.add_columns(t, theta_hat / space.scale @ nullspace.P_perp, components)
    chosen = shared(space, nullspace.r, truth.theta)
    if not len(chosen):
        return [along]
    panels = [along]
    if len(space.actuators) < 2:  # with several actuators the page's panel has their ratios
        share = _recorded("share", "Parameters relative to the truth", "θ̂/θ, over the mean [–]")
        names = [f"{space.labels[i]} [–]" for i in chosen]
        share.add_columns(t, shares(theta_hat[:, chosen], true[:, chosen]), names)
        panels.append(share)
    error = _recorded("share_error", "Error of ratios of parameters", "error [%]")
    for k, (name, label) in enumerate(_identifiers(run)):
        estimate = record.rows(f"theta_hat_{name}" if name else "theta_hat", rows)
        ratio = shares(estimate[:, chosen], true[:, chosen])
        place = _place(result, name, k)
        error.add(t, 100 * np.abs(ratio - 1).max(axis=1), label, place=place, part=(label,))
    return [*panels, error]


def shares(theta_hat: Array, truth: Array) -> Array:
    """(N, k) ratios of estimate to truth, both (N, k), over their mean; 1 where exact."""
    ratio = theta_hat / truth
    return ratio / ratio.mean(axis=1, keepdims=True)


def _forces(run: Run, truth: Truth | None) -> list[Comparison]:
    """Predicted against measured force along every velocity, the worst predicted first."""
    found = forces_of(run, truth)
    if found is None or not found.measured.any():
        return []
    size = np.abs(found.measured).max(axis=0)
    none = (size < _VANISHED * size.max()) & bool(run.system.structure.contacts)
    points = min(len(found.t), _FORCE_POINTS)
    rows = np.unique(np.linspace(0, len(found.t) - 1, points).astype(int))
    labels = run.system.velocity_labels
    units = run.system.force_units
    error = found.nrmse
    order = np.argsort(-np.where(np.isfinite(error), error, -1.0), kind="stable")
    panels = []
    for j in order[~none[order]]:  # a leg's own rows say its foot's force, and nothing else
        known = np.isfinite(error[j])
        number = percent(float(error[j]))
        note = f": error {number}" if known else ", not actuated"
        kind = {"N": "force", "N·m": "torque"}.get(units[j], "generalised force")
        panels.append(
            Comparison(
                f"{labels[j]}{note}",
                kind,
                units[j],
                found.t[rows],
                found.measured[rows, j],
                found.predicted[rows, j],
                None if found.half is None else found.half[rows, j],
            )
        )
    return panels
