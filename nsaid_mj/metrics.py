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

from .confidence import known
from .experiment import Run, Seeds, held_out
from .identifiers import Identifier, IdentifierConfig
from .identifiers.nullspace_aid import NullspaceIdentifier
from .nullspace import Nullspace, directions, regressor_stack, split, structural
from .parameters import Array, ParameterSpace
from .persistence import level
from .record import Record
from .system import SecondOrderSystem

_PACKAGES = ("mujoco", "pin", "numpy", "scipy", "numba", "rerun-sdk", "pyarrow")
_ROWS = 2000  # how many rows of a trajectory judge a force residual, at most
_NUMBERS = 20_000_000  # how many numbers of regressors are held at once
_UNSOLVED = 1e-6  # share of V(0) that an implicit step may miss its solution by
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
    "lyapunov_violations", "pe_level", "pe_level_perp", "pe_share_perp",
    "velocity_error_rms_initial", "excited_error_rms", "excited_error_rms_initial",
    "confidence",
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
        "law": law_of(run.scenario.identifier),
        "gamma": getattr(run.scenario.identifier, "gamma", "scale"),
        "sensors": run.scenario.sensors,
        "mismatch": mismatches(run),
        "fault": run.plant.fault.told(system),
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
    record, system, truth = run.record, run.plant.system, true_theta(run)
    later, law = held_out(run), run.identifiers[""]
    V = energy(run)
    rises, bound = lyapunov_rises(V, law, record)
    rises[np.diff(run.plant.struck(record["t"]))] = 0.0  # where the truth jumped, and V with it
    stepped = law.implicit(record["t"])
    if "" in run.states:
        bound = bound + stepped * (law.slack(run.states[""], truth) + _UNSOLVED * V[0])
    else:
        rises[stepped] = 0.0  # only a memory could judge its steps
    conserved = kept(law, record)
    levels = persistence_levels(run)
    margin, least_mass = assumption_46(run)
    return {
        "r_excited": excited_nullspace(run).r,
        **judge(run, "", later),
        "conserved_drift": float(np.max(np.abs(conserved / conserved[0] - 1)))
        if law.conserves
        else None,
        "lyapunov_violations": int(np.count_nonzero(rises > bound)),
        "lyapunov_largest_rise": float(rises.max(initial=0.0) / (V[0] or np.inf)),
        "lyapunov_bound": float(np.max(bound, initial=0.0) / (V[0] or np.inf)),
        "pe_level": levels[0],
        "pe_level_perp": levels[1],
        "pe_share_perp": levels[2],
        **settling(run),
        "assumption_46_margin": margin,
        "least_mass_eigenvalue": least_mass,
        "least_estimated_pivot": float(record["pivot"][1:].min()) if len(record) > 1 else None,
        "rivals": {
            name: judge(run, name, later) | {"status": run.statuses[name].words}
            for name in record.rivals
        },
        "confidence": confidence(run),
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


def law_of(identifier: IdentifierConfig) -> str:
    """`paper`, `cone` or `memory`; `paper` too where a law leaves the barrier out."""
    law = getattr(identifier, "law", "paper")
    return law if law != "cone" or identifier.in_cone else "paper"


def kept(law: Identifier, record: Record) -> Array:
    """(N,) the law's conserved quantity along a record, with what implicit steps have taken."""
    return law.conserved(record["theta_hat"]) + record["spent"]


def confidence(run: Run) -> dict[str, Any] | None:
    """How well the run's own identifier says it knows every direction, and whether it is right.

    None where the law does not say, or the run was read back and nobody has told it before.
    """
    stated = run.identifiers[""].confidence(run.states[""]) if "" in run.states else None
    if stated is None:
        return run.confidence
    system, theta = run.plant.system, run.record["theta_hat"][-1]
    space = system.space
    rng = np.random.default_rng(Seeds.of(run.scenario.seed).structure)
    found = known(stated, theta, structural(system, theta, rng), space)
    return {
        "directions": len(found.deviation),
        "below_noise": int(found.below_noise.sum()),
        "covered": found.covered(theta / space.scale, true_theta(run) / space.scale),
        "deviation_median": float(np.median(found.deviation)),
        "deviation_largest": float(found.deviation.max()),
        "independent_samples": [float(blocks) for blocks in found.blocks],
        "actuators": {
            space.names[k]: float(s) for k, s in zip(space.actuators, found.actuators, strict=True)
        },
        "worst_known": [
            {"deviation": float(s), "below_noise": bool(low), "parameters": leading(d, space)}
            for s, low, d in zip(
                found.deviation[:-6:-1], found.below_noise[:-6:-1], found.directions[:-6:-1],
                strict=True,
            )
        ],
    }  # fmt: skip


def confidence_lines(summary: dict[str, Any]) -> list[str]:
    """What the confidence says, in words; none where the law does not say."""
    stated = summary["confidence"]
    if stated is None:
        return []
    worst, actuators = stated["worst_known"][0], stated["actuators"]
    lines = [
        f"known to ±{stated['deviation_median']:.2g} of ‖θ̂‖ along half of {stated['directions']} "
        f"directions, to ±{stated['deviation_largest']:.2g} along the worst "
        f"({', '.join(worst['parameters'])}); {stated['below_noise']} are below the noise",
        f"95 % intervals hold the truth in {100 * stated['covered']:.0f} % of the directions",
    ]
    if len(actuators) > 1:
        name = max(actuators, key=lambda key: actuators[key])
        lines.append(f"actuators' shares to ±{100 * actuators[name]:.2g} % or better ({name})")
    return lines


def leading(direction: Array, space: ParameterSpace, count: int = 3) -> dict[str, float]:
    """The parameters that a direction in θ/scale moves most, and by how much."""
    most = np.argsort(-np.abs(direction))[:count]
    return {space.names[i]: float(direction[i]) for i in most}


def unobservable_lines(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """(what, remedy) of the unobservable directions; those of one parameter each in one line."""
    lines = summary["unobservable"]
    alone = [line["parameters"][0] for line in lines if len(line["parameters"]) == 1]
    told = [(line["direction"], line["fix"]) for line in lines if len(line["parameters"]) > 1]
    if alone:
        what = f"{', '.join(alone)}: without effect on the motion, each alone"
        told.insert(1, (what, "nothing but knowing them"))
    return told


def true_theta(run: Run) -> Array:
    """(p,) the true θ at the run's end."""
    return run.plant.truth_at(run.ending.time)


def true_nullspace(run: Run) -> Nullspace:
    """P_s(θ) of the run's plant under its true θ at the end, structural: over all motions."""
    return _nullspace(run, bool(run.plant.struck(run.ending.time)))


@lru_cache(maxsize=2)
def _nullspace(run: Run, struck: bool) -> Nullspace:
    rng = np.random.default_rng(Seeds.of(run.scenario.seed).structure)
    return structural(run.plant.system, true_theta(run) if struck else run.plant.truth, rng)


def distance(run: Run, t: Array, theta_hat: Array) -> Array:
    """(N,) ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ of estimates (N, p), each under the true θ of its time t (N,)."""
    struck, theta_s = run.plant.struck(t), theta_hat / run.plant.system.space.scale
    ratio = np.empty(len(t))
    for state in np.unique(struck):
        ratio[struck == state] = _nullspace(run, bool(state)).ratio(theta_s[struck == state])
    return ratio


def judge(run: Run, name: str, later: Record | None) -> dict[str, Any]:
    """How near one identifier's last estimate is to the true set, and how well it predicts."""
    suffix = f"_{name}" if name else ""
    record, system, truth = run.record, run.plant.system, true_theta(run)
    theta = record[f"theta_hat{suffix}"]
    ratio = distance(run, record["t"][[0, -1]], theta[[0, -1]])
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
    rows = held_out_rows(system, later, truth)
    return None if rows is None else residual_ratio(*rows, theta_hat)


def held_out_rows(
    system: SecondOrderSystem, later: Record | None, truth: Array | None
) -> tuple[Array, Array] | None:
    """(k, n, p) W and its actuator columns alone, on a later trajectory; see the ratio above."""
    if later is None:
        return None
    stride = _stride(later, system)
    if truth is not None:
        t, x, v, u = _states(later, stride)
        a = system.acceleration(t, x, v, u, truth)
    else:
        t, x, v, u, a = _half_way(later, system, stride)
    actuation, k = np.zeros(system.p), system.space.actuators
    actuation[k] = 1.0
    return system.regressor(t, x, v, a, u), system.F(t, x, u) * actuation


def residual_ratio(W: Array, actuation: Array, theta_hat: Array) -> float | None:
    """rms of W θ̂ over rms of the actuator forces; None where there are none."""
    force = actuation @ theta_hat
    if not force.any():
        return None
    return float(np.sqrt(np.mean((W @ theta_hat) ** 2) / np.mean(force**2)))


class Judge:
    """Judges any method's estimates of one plant, after the fact, by the same figures.

    Args:
        run: whose plant it is; its identifiers and its record are not looked at.
    """

    def __init__(self, run: Run):
        self._system, self._truth = run.plant.system, true_theta(run)
        self._nullspace = true_nullspace(run)
        self._rows = held_out_rows(
            self._system, held_out(run), None if run.plant.mismatches else self._truth
        )

    def __call__(self, theta_hat: Array) -> dict[str, float | None]:
        """Distance to the true set, error of the actuators' shares, and force residual."""
        system = self._system
        return {
            "theta_perp_ratio": float(self._nullspace.ratio(theta_hat / system.space.scale)),
            "actuator_ratio_error": actuator_ratio_error(system, theta_hat, self._truth),
            "force_residual_ratio": residual_ratio(*self._rows, theta_hat) if self._rows else None,
        }


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


def energy(run: Run) -> Array:
    """(N,) V of the scenario's own identifier, under the true θ of each row's time."""
    system, law, record = run.plant.system, run.identifiers[""], run.record
    V, struck = lyapunov(system, law, record, run.plant.truth), run.plant.struck(record["t"])
    if not struck.any():
        return V
    return np.where(struck, lyapunov(system, law, record, true_theta(run)), V)


def lyapunov_rises(V: Array, law: Identifier, record: Record) -> tuple[Array, Array]:
    """By how much V rose from each row to the next, and what the integrator may be blamed for.

    Returns:
        (N−1,) rises, ≤ 0 where V fell; (N−1,) bounds.

    V̇ = −Δvᵀ M K Δv ≤ 0 (69) holds for the exact flow. RK4 makes an error in each step; the same
    error shows in θ̂ᵀ Γ⁻¹ θ̂, which (30) conserves exactly and which is half of V's second term
    but for Δθ in place of θ̂. The bound is that measured defect over the run, per row, plus the
    rounding of V itself.
    """
    conserved = kept(law, record)
    defect = np.max(np.abs(np.diff(conserved)), initial=0.0)
    sizes = np.maximum(V[1:], conserved[1:]) + law.cancelling
    rounding = 8 * np.finfo(float).eps * sizes
    return np.diff(V), defect + rounding


def settling(run: Run) -> dict[str, float]:
    """What Theorem 1 (70) and Lemma 1 (74) send to 0: rms over the first tenth and the last [SI].

    `velocity_error` is Δv, whose last tenth `judge` has; `excited_error` is W(t, x, v, θ) θ̂, which
    is W(t, x, v, θ) P̄_⊥ θ̄_P⊥.
    """
    record, system = run.record, run.plant.system
    stride = _stride(record, system)
    t, x, v, u = _states(record, stride)
    a = _acceleration(run, t, x, v, u)
    W = system.regressor(t, x, v, a, u)
    error = np.einsum("kij,kj->ki", W, record["theta_hat"][::stride])
    first, last = _first_and_last(error)
    return {
        "velocity_error_rms_initial": _first_and_last(record["v_hat"] - record["v"])[0],
        "excited_error_rms_initial": first,
        "excited_error_rms": last,
    }


def _acceleration(run: Run, t: Array, x: Array, v: Array, u: Array) -> Array:
    """(N, n) the true v̇ of (29) at rows of a run, each under the true θ of its time."""
    system, struck = run.plant.system, run.plant.struck(t)
    a = system.acceleration(t, x, v, u, run.plant.truth)
    if struck.any():
        late = t[struck], x[struck], v[struck], u[struck]
        a[struck] = system.acceleration(*late, true_theta(run))
    return a


def _first_and_last(error: Array) -> tuple[float, float]:
    """rms of an error (N, n) over the first and the last tenth of its rows."""
    tenth = max(1, len(error) // 10)
    first, last = (float(np.sqrt(np.mean(part**2))) for part in (error[:tenth], error[-tenth:]))
    return first, last


def persistence_levels(run: Run) -> tuple[float, float, float | None]:
    """Smallest ε₀ of (2) for W(t, x, v̂, θ̂) and of (75) over the run's whole windows, or 0.

    A window in which the truth jumps does not count.

    Returns:
        Both levels [N·m·s]; the smallest share that (75)'s has of (δ₀ ∫ ‖W‖² dτ)^½ of its window,
        all excitation in it. None where no whole window has rows enough for every direction.
    """
    scenario, record, system = run.scenario, run.record, run.plant.system
    rows = round(scenario.pe_window / (scenario.dt * scenario.record_every))
    stride = max(1, rows // _WINDOW_ROWS)
    dt = stride * scenario.record_every * scenario.dt
    t, x, v, u = _states(record, stride)
    v_hat, theta_hat = record["v_hat"][::stride], record["theta_hat"][::stride]
    per_window = max(1, rows // stride)
    full: list[float] = []
    perpendicular: list[float] = []
    shares: list[float] = []
    for start in range(0, len(t) - per_window + 1, per_window):
        k = slice(start, start + per_window)
        struck = run.plant.struck(t[k])
        if struck[0] != struck[-1]:
            continue
        a = _acceleration(run, t[k], x[k], v[k], u[k])
        W = system.regressor(t[k], x[k], v[k], a, u[k]) * system.space.scale
        P_perp = _nullspace(run, bool(struck[0])).P_perp
        perpendicular.append(level(W, dt, P_perp))
        if W.shape[0] * W.shape[1] >= P_perp.shape[1]:
            everything = np.sqrt(len(W)) * dt * np.linalg.norm(W)
            shares.append(perpendicular[-1] / (everything or np.inf))
        a_hat = np.array([system.acceleration(*sample) for sample in
                          zip(t[k], x[k], v_hat[k], u[k], theta_hat[k], strict=True)])  # fmt: skip
        full.append(
            level(system.regressor(t[k], x[k], v_hat[k], a_hat, u[k]) * system.space.scale, dt)
        )
    if not full:
        return 0.0, 0.0, None
    return min(full), min(perpendicular), float(min(shares)) if shares else None


def excited_nullspace(run: Run) -> Nullspace:
    """The directions that this run's own motion has left unexcited, since the fault if any."""
    system = run.plant.system
    t, x, v, u = _states(run.record, _stride(run.record, system))
    k = run.plant.struck(t) == run.plant.struck(t[-1])
    t, x, v, u = t[k], x[k], v[k], u[k]
    a = system.acceleration(t, x, v, u, true_theta(run))
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
