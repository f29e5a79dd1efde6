"""What a run's numbers are: read the truth after the fact, judge, write summary.json."""

from __future__ import annotations

import json
import os
import platform
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .experiment import Run, Seeds, held_out
from .identifiers import Identifier
from .identifiers.nullspace_aid import NullspaceIdentifier
from .nullspace import Nullspace, directions, regressor_stack, split, structural
from .parameters import Array
from .persistence import level
from .record import Record
from .system import SecondOrderSystem

_PACKAGES = ("mujoco", "pin", "numpy", "scipy", "numba", "rerun-sdk", "pyarrow")
_ROWS = 2000  # how many rows of a trajectory judge a force residual, at most
_NUMBERS = 20_000_000  # how many numbers of regressors are held at once
_WINDOW_ROWS = 100  # how many regressors judge one window's excitation

OWN = "NS-AID"
"""What a scenario's own identifier is called beside its rivals."""

FIGURES = (
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at first", "theta_perp_ratio_initial", ""),
    ("… at the end", "theta_perp_ratio", ""),
    ("direction of the plant alone, error", "plant_direction_error", "%"),
    ("largest error of an actuator's share", "actuator_ratio_error", "%"),
    ("force residual on another trajectory", "force_residual_ratio", "%"),
    ("rms Δv over the last tenth [SI]", "velocity_error_rms", ""),
)
"""What terminal, report and recording tell of every identifier: label, key, unit."""

_UNKNOWN = (
    "r_excited", "theta_perp_ratio_initial", "theta_perp_ratio", "plant_direction_error",
    "actuator_ratio_error", "force_residual_ratio", "velocity_error_rms", "conserved_drift",
    "lyapunov_violations", "pe_level", "pe_level_perp",
)  # fmt: skip
"""What a run that ended before its first row does not know."""


def figure(value: float | None, unit: str) -> str:
    """A figure with three digits, as a percentage where its unit is %; – where there is none."""
    if value is None:
        return "–"
    return f"{100 * value:.3g} %" if unit == "%" else f"{value:.3g}"


def summarize(run: Run) -> dict[str, Any]:
    """Every key of a run's summary.json.

    Args:
        run: a run that has ended, however it did.
    """
    found = _findings(run) if len(run.record) else dict.fromkeys(_UNKNOWN) | {"rivals": {}}
    ending, cost, system = run.ending, run.cost, run.plant.system
    sim, steps = float(run.record["t"][-1]) if len(run.record) else 0.0, max(cost.steps, 1)
    nullspace = true_nullspace(run)
    return {
        "status": ending.status.words,
        "status_time": ending.time,
        "status_signal": ending.signal,
        "status_remedy": ending.status.remedy,
        "n": system.n,
        "p": system.p,
        "r": nullspace.r,
        "rank_tolerance": nullspace.tolerance,
        "rank_gap": [float(s) for s in nullspace.gap],
        **found,
        "law": "cone" if run.scenario.identifier.in_cone else "paper",
        "gamma": getattr(run.scenario.identifier, "gamma", "scale"),
        "sensors": run.scenario.sensors,
        "mismatch": mismatches(run),
        "unobservable": [
            {"direction": d.words, "fix": d.fix, "parameters": list(d.parameters)}
            for d in directions(nullspace, system.space)
        ],
        "wall_s": cost.wall,
        "sim_s": sim,
        "real_time_factor": sim / cost.wall if cost.wall else 0.0,
        "identifier_us_per_step": 1e6 * cost.identifier / steps,
        "plant_us_per_step": 1e6 * cost.plant / steps,
        "seed": run.scenario.seed,
        "versions": versions(),
        "scenario_hash": run.scenario.hash,
    }


def _findings(run: Run) -> dict[str, Any]:
    """What a record of at least one row tells, under the truth."""
    record, system, truth = run.record, run.plant.system, run.plant.truth
    nullspace, later, law = true_nullspace(run), held_out(run), run.identifiers[""]
    V = lyapunov(system, law, record, truth)
    rises, bound = lyapunov_rises(V, law, record)
    conserved = law.conserved(record["theta_hat"])
    levels = persistence_levels(run, nullspace)
    margin, least_mass = assumption_46(run)
    return {
        "r_excited": excited_nullspace(run).r,
        **judge(run, "", nullspace, later),
        "conserved_drift": float(np.max(np.abs(conserved / conserved[0] - 1)))
        if law.conserves
        else None,
        "lyapunov_violations": int(np.count_nonzero(rises > bound)),
        "lyapunov_largest_rise": float(rises.max(initial=0.0) / (V[0] or np.inf)),
        "lyapunov_bound": float(np.max(bound, initial=0.0) / (V[0] or np.inf)),
        "pe_level": levels[0],
        "pe_level_perp": levels[1],
        "assumption_46_margin": margin,
        "least_mass_eigenvalue": least_mass,
        "least_estimated_pivot": float(record["pivot"][1:].min()) if len(record) > 1 else None,
        "rivals": {
            name: judge(run, name, nullspace, later) | {"status": run.statuses[name].words}
            for name in record.rivals
        },
        "parameters": [
            {"name": name, "unit": unit, "scale": float(s), "true": float(t), "prior": float(a),
             "estimate": float(b)}
            for name, unit, s, t, a, b in zip(system.space.names, system.space.units,
                                              system.space.scale, truth, run.prior,
                                              record["theta_hat"][-1], strict=True)
        ],
    }  # fmt: skip


def mismatches(run: Run) -> list[str]:
    """What the run's plant and sensors did that the structure does not know, in words."""
    scenario, words = run.scenario, list(run.plant.mismatches)
    if scenario.sensors == "noisy":
        noise = scenario.noise
        words.append(f"sensor noise {noise.position:g} and {noise.velocity:g} [SI]")
        if noise.encoder_step:
            words.append(f"positions quantised to {noise.encoder_step:g}")
    return words


def unobservable_lines(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """(what, remedy) of the unobservable directions; those of one parameter each in one line."""
    lines = summary["unobservable"]
    alone = [line["parameters"][0] for line in lines if len(line["parameters"]) == 1]
    told = [(line["direction"], line["fix"]) for line in lines if len(line["parameters"]) > 1]
    if alone:
        what = f"{', '.join(alone)}: without effect on the motion, each alone"
        told.insert(1, (what, "nothing but knowing them"))
    return told


@lru_cache(maxsize=1)
def true_nullspace(run: Run) -> Nullspace:
    """P_s(θ) of the run's plant under its true θ, structural: over all motions."""
    rng = np.random.default_rng(Seeds.of(run.scenario.seed).structure)
    return structural(run.plant.system, run.plant.truth, rng)


def judge(run: Run, name: str, nullspace: Nullspace, later: Record | None) -> dict[str, Any]:
    """How near one identifier's last estimate is to the true set, and how well it predicts."""
    suffix = f"_{name}" if name else ""
    record, system, truth = run.record, run.plant.system, run.plant.truth
    theta = record[f"theta_hat{suffix}"]
    ratio = nullspace.ratio(theta[[0, -1]] / system.space.scale)
    dv = record[f"v_hat{suffix}"] - record["v"]
    return {
        "theta_perp_ratio": float(ratio[1]),
        "theta_perp_ratio_initial": float(ratio[0]),
        "plant_direction_error": plant_direction_error(system, theta[-1], truth),
        "actuator_ratio_error": actuator_ratio_error(system, theta[-1], truth),
        "force_residual_ratio": force_residual_ratio(
            system, later, theta[-1], None if run.plant.mismatches else truth
        ),
        "velocity_error_rms": float(np.sqrt(np.mean(dv[-max(1, len(dv) // 10) :] ** 2))),
    }


def actuator_ratio_error(system: SecondOrderSystem, theta_hat: Array, truth: Array) -> float:
    """max |(k̂_i/k_i)/mean(k̂/k) − 1| over the actuator parameters; 0 where there is only one."""
    ratio = theta_hat[system.space.actuators] / truth[system.space.actuators]
    return float(np.max(np.abs(ratio / np.mean(ratio) - 1))) if len(ratio) > 1 else 0.0


def plant_direction_error(system: SecondOrderSystem, theta_hat: Array, truth: Array) -> float:
    """Sine of the angle between what is observable of the estimated and the true plant.

    The plant is θ/scale without its actuators; what is observable of it, were the actuator forces
    known, is orthogonal to the nullspace of the plant's own columns of W. 0 is right up to a
    common scale, and 1 is at right angles.
    """
    plant = np.setdiff1d(np.arange(system.p), system.space.actuators)
    rng = np.random.default_rng(0)
    W = regressor_stack(system, truth, rng)[:, plant]
    basis = split(W).P_perp
    estimated, true = ((theta / system.space.scale)[plant] @ basis for theta in (theta_hat, truth))
    cosine = estimated @ true / (np.linalg.norm(estimated) * np.linalg.norm(true))
    return float(np.sqrt(max(0.0, 1 - cosine**2)))


def force_residual_ratio(
    system: SecondOrderSystem,
    later: Record | None,
    theta_hat: Array,
    truth: Array | None,
) -> float | None:
    """rms of W(t, x, v, v̇) θ̂ with the true v̇, over rms of the actuator forces under θ̂.

    Args:
        system: the structure.
        later: a trajectory that the estimate has not seen.
        theta_hat: (p,) the estimate.
        truth: (p,) θ of (29), for the true v̇; None where the plant does what no θ can say: v̇ is
            then the difference of measured velocities, half-way between samples.

    Returns:
        None where the plant has no later trajectory, or is not driven on it.
    """
    if later is None:
        return None
    stride = _stride(later, system)
    if truth is not None:
        t, x, v, u = _states(later, stride)
        a = system.acceleration(t, x, v, u, truth)
    else:
        t, x, v, u, a = _half_way(later, system, stride)
    residual = system.regressor(t, x, v, a, u) @ theta_hat
    k = system.space.actuators
    force = system.F(t, x, u)[..., k] @ theta_hat[k]
    if not force.any():
        return None
    return float(np.sqrt(np.mean(residual**2) / np.mean(force**2)))


def _half_way(
    record: Record, system: SecondOrderSystem, stride: int
) -> tuple[Array, Array, Array, Array, Array]:
    """(t, x, v, u, v̇) half-way between neighbouring rows, of every stride-th row."""
    k = np.arange(0, len(record) - 1, stride)
    t, q, v, u = record["t"], record["q"], record["v"], record["u"][k]
    steps = [0.5 * system.difference(q[i], q[i + 1]) for i in k]
    middle = np.array([system.integrate(q[i], step) for i, step in zip(k, steps, strict=True)])
    mean = 0.5 * (v[k] + v[k + 1])
    rate = (v[k + 1] - v[k]) / (t[k + 1] - t[k])[:, None]
    return 0.5 * (t[k] + t[k + 1]), np.hstack([middle, mean]), mean, u, rate


def lyapunov(system: SecondOrderSystem, law: Identifier, record: Record, truth: Array) -> Array:
    """(N,) V = ½ Δvᵀ M(x, θ) Δv + ½ Δθᵀ Γ⁻¹ Δθ (66), with the true θ.

    Parameters that an identifier holds do not count: they have no Γ⁻¹.
    """
    dv = record["v_hat"] - record["v"]
    x = np.hstack([record["q"], record["v"]])
    rows = max(1, _NUMBERS // (system.n * system.p))
    momentum = [system.W_M(x[k : k + rows], dv[k : k + rows]) @ truth
                for k in range(0, len(x), rows)]  # fmt: skip
    kinetic = np.einsum("ki,ki->k", dv, np.concatenate(momentum))
    return 0.5 * kinetic + law.divergence(truth, record["theta_hat"])


def lyapunov_rises(V: Array, law: Identifier, record: Record) -> tuple[Array, Array]:
    """By how much V rose from each row to the next, and what the integrator may be blamed for.

    Returns:
        (N−1,) rises, ≤ 0 where V fell; (N−1,) bounds.

    V̇ = −Δvᵀ M K Δv ≤ 0 (69) holds for the exact flow. RK4 makes an error in each step; the same
    error shows in θ̂ᵀ Γ⁻¹ θ̂, which (30) conserves exactly and which is half of V's second term
    but for Δθ in place of θ̂. The bound is that measured defect over the run, per row, plus the
    rounding of V itself.
    """
    conserved = law.conserved(record["theta_hat"])
    defect = np.max(np.abs(np.diff(conserved)), initial=0.0)
    rounding = 8 * np.finfo(float).eps * np.maximum(V[1:], conserved[1:])
    return np.diff(V), defect + rounding


def persistence_levels(run: Run, nullspace: Nullspace) -> tuple[float, float]:
    """Smallest ε₀ of (2) for W(t, x, v̂, θ̂) and of (75) over the run's whole windows, or 0."""
    scenario, record, system = run.scenario, run.record, run.plant.system
    rows = round(scenario.pe_window / (scenario.dt * scenario.record_every))
    stride = max(1, rows // _WINDOW_ROWS)
    dt = stride * scenario.record_every * scenario.dt
    t, x, v, u = _states(record, stride)
    v_hat, theta_hat = record["v_hat"][::stride], record["theta_hat"][::stride]
    per_window = max(1, rows // stride)
    full: list[float] = []
    perpendicular: list[float] = []
    for start in range(0, len(t) - per_window + 1, per_window):
        k = slice(start, start + per_window)
        a = system.acceleration(t[k], x[k], v[k], u[k], run.plant.truth)
        W = system.regressor(t[k], x[k], v[k], a, u[k]) * system.space.scale
        perpendicular.append(level(W, dt, nullspace.P_perp))
        a_hat = np.array([system.acceleration(*sample) for sample in
                          zip(t[k], x[k], v_hat[k], u[k], theta_hat[k], strict=True)])  # fmt: skip
        full.append(
            level(system.regressor(t[k], x[k], v_hat[k], a_hat, u[k]) * system.space.scale, dt)
        )
    return (min(full), min(perpendicular)) if full else (0.0, 0.0)


def excited_nullspace(run: Run) -> Nullspace:
    """The directions that this run's own motion has left unexcited."""
    system = run.plant.system
    t, x, v, u = _states(run.record, _stride(run.record, system))
    a = system.acceleration(t, x, v, u, run.plant.truth)
    W = system.regressor(t, x, v, a, u) * system.space.scale
    return split(W.reshape(-1, system.p))


def assumption_46(run: Run) -> tuple[float | None, float]:
    """The margin of (46), negative where it fails, and λ_min(M(x, θ)) over the run.

    (46) asks for √(λ_max(Γ) Δθ(t₀)ᵀ Γ⁻¹ Δθ(t₀)) + ε ≤ λ_min(M(x, θ)), which mixes units: it is
    evaluated as it stands, in SI units. Without it M̂ may lose definiteness; most runs do without.
    """
    law, system = run.identifiers[""], run.plant.system
    _, x, _, _ = _states(run.record, max(1, len(run.record) // 200))
    least = float(np.linalg.eigvalsh(system.mass_matrix(x, run.plant.truth)).min())
    constant = not run.scenario.identifier.in_cone
    if not (constant and isinstance(law, NullspaceIdentifier) and law.conserves):
        return None, least  # (46) speaks of a constant Γ of full rank
    error = law.conserved(run.prior - run.plant.truth)
    gain = law.Gamma
    largest = gain.max() if gain.ndim == 1 else np.linalg.eigvalsh(gain)[-1]
    return float(least - np.sqrt(largest * error)), least


def versions() -> dict[str, str]:
    """What a run depends on beside its scenario."""
    own = {"nsaid-mj": version("nsaid-mj"), "python": platform.python_version()}
    return own | {name: version(name) for name in _PACKAGES}


def write_json(path: Path, value: Any) -> None:
    """Writes JSON, whole or not at all.

    Raises:
        ValueError: a number is NaN or infinite.
    """
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Writes under another name, syncs and renames: a file is whole or not there."""
    partial = path.with_name(f".{path.name}.part")
    with partial.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    partial.replace(path)


def _stride(record: Record, system: SecondOrderSystem) -> int:
    """Every how many rows one is taken, so that not more regressors are held than needed."""
    rows = min(_ROWS, max(50, _NUMBERS // (system.n * system.p)))
    return max(1, len(record) // rows)


def _states(record: Record, stride: int) -> tuple[Array, Array, Array, Array]:
    """(t, x, v, u) of every stride-th row."""
    k = slice(None, None, stride)
    v = record["v"][k]
    return record["t"][k], np.hstack([record["q"][k], v]), v, record["u"][k]
