"""Every key of a run's summary.json."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import Any

import numpy as np

from ..experiment.loop import Run, held_out
from ..experiment.record import Record
from ..experiment.setup import Seeds
from ..identifiers import ConventionalAID, IdentifierConfig
from ..nullspace import directions, structural
from ..parameters import Array, ParameterSpace
from .confidence import known
from .figures import held_out_rows, judge
from .lyapunov import assumption_46, lyapunov_figures
from .motion import motion_figures, persistence_levels
from .truth import true_nullspace, true_theta
from .verdict import residual_floor, verdict

_PACKAGES = ("mujoco", "pin", "numpy", "scipy", "numba", "rerun-sdk", "pyarrow")

_UNKNOWN = (
    "r_excited", "theta_perp_ratio_initial", "theta_perp_ratio", "plant_direction_error",
    "actuator_ratio_error", "force_residual_ratio", "force_residual_floor", "velocity_error_rms",
    "conserved_drift",
    "lyapunov_violations", "pe_level", "pe_level_perp", "pe_share_perp",
    "velocity_error_rms_initial", "excited_error_rms", "excited_error_rms_initial",
    "confidence",
)  # fmt: skip
"""What a run that ended before its first row does not know."""


def summarize(run: Run) -> dict[str, Any]:
    """Every key of a run's summary.json.

    Args:
        run: a run that has ended, however it did.
    """
    summary = _summary(run)
    return summary | {"verdict": verdict(summary)}


def _summary(run: Run) -> dict[str, Any]:
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
        "gains_held": isinstance(run.scenario.identifier, ConventionalAID),
        "gamma": getattr(run.scenario.identifier, "gamma", "scale"),
        "sensors": run.scenario.sensors,
        "mismatch": mismatches(run),
        "fault": run.plant.fault.told(system),
        "unobservable": [
            {
                "direction": d.words,
                "fix": d.fix,
                "parameters": list(d.parameters),
                "labels": [system.space.labels[system.space.index(name)] for name in d.parameters],
            }
            for d in directions(nullspace, system.space)
        ],
        "wall_s": cost.wall,
        "compile_s": cost.compile,
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
    record, space, truth = run.record, run.plant.system.space, true_theta(run)
    later, levels = held_out(run), persistence_levels(run)
    margin, least_mass = assumption_46(run)
    return {
        **judge(run, "", later),
        "force_residual_floor": force_residual_floor(run, later),
        **lyapunov_figures(run),
        "pe_level": levels[0],
        "pe_level_perp": levels[1],
        "pe_share_perp": levels[2],
        **motion_figures(run),
        "assumption_46_margin": margin,
        "least_mass_eigenvalue": least_mass,
        "least_estimated_pivot": float(record["pivot"][1:].min()) if len(record) > 1 else None,
        "rivals": {
            name: judge(run, name, later) | {"status": run.statuses[name].words}
            for name in record.rivals
        },
        "confidence": confidence(run),
        "parameters": [
            {"name": name, "label": label, "unit": unit, "scale": float(s), "true": float(t),
             "prior": float(a), "estimate": float(b)}
            for name, label, unit, s, t, a, b in zip(
                space.names, space.labels, space.units, space.scale, truth, run.prior,
                record["theta_hat"][-1], strict=True,
            )
        ],
    }  # fmt: skip


def force_residual_floor(run: Run, later: Record | None) -> float | None:
    """The share of the actuator forces on a later trajectory that no θ of the structure explains.

    0 where the plant is of the structure: its true θ explains all.
    """
    if later is None:
        return None
    if not run.plant.mismatches:
        return 0.0
    return residual_floor(run.plant.system, held_out_rows(run.plant.system, later, None))


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


def leading(direction: Array, space: ParameterSpace, count: int = 3) -> dict[str, float]:
    """The parameters that a direction in θ/scale moves most, and by how much."""
    most = np.argsort(-np.abs(direction))[:count]
    return {space.names[i]: float(direction[i]) for i in most}


def versions() -> dict[str, str]:
    """What a run depends on beside its scenario."""
    own = {"nsaid-mj": version("nsaid-mj"), "python": platform.python_version()}
    return own | {name: version(name) for name in _PACKAGES}
