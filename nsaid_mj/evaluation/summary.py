"""Assembles a run's summary.json."""

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from ..bounds import without_nonfinite
from ..experiment.loop import Run
from ..laws import ConventionalAID, IdentifierConfig, NullspaceAID
from ..nullspace import directions
from ..numerics.threads import single_threaded
from ..parameters import ParameterSpace, rounded
from .confidence import Determined, determined, known
from .excitation import motion_figures, persistence_figures
from .figures import held_out_rows, judge, residual_floor
from .lyapunov import assumption_46, conserved_drift, lyapunov_figures
from .run_misfit import misfit_of
from .truth import Truth, nullspace_of
from .words import verdict

_CORRELATED = 40  # parameters whose correlations are kept, at most
_PACKAGES = ("mujoco", "pin", "numpy", "scipy", "numba", "rerun-sdk", "pyarrow")

_OF_THE_TRUTH = (
    "r_excited",
    "theta_perp_ratio_initial",
    "theta_perp_ratio",
    "plant_direction_error",
    "actuator_ratio_error",
    "force_residual_ratio",
    "force_residual_floor",
    "lyapunov_violations",
    "pe_level_perp",
    "pe_share_perp",
    "excited_error_rms",
    "excited_error_rms_initial",
)
"""Keys that are null if the run ended before its first row, even though its truth is known."""

_OF_THE_RECORD = (
    "velocity_error_rms",
    "velocity_error_rms_initial",
    "conserved_drift",
    "pe_level",
    "confidence",
)
"""Keys that are null if the run ended before its first row."""


@single_threaded
def summarize(run: Run, truth: Truth | None) -> dict[str, Any]:
    """Computes every key of the summary.json of a run, completed or not.

    Without the truth of its plant, the keys that need it are absent, and the unobservable
    directions are those at the last estimate. Figures that are not finite are None, as JSON cannot
    represent them.
    """
    summary = without_nonfinite(_summary(run, truth))
    return summary | {"verdict": verdict(summary)}


def _summary(run: Run, truth: Truth | None) -> dict[str, Any]:
    if len(run.record):
        found = _findings(run, truth)
    else:
        keys = _OF_THE_RECORD + (_OF_THE_TRUTH if truth else ())
        found = dict.fromkeys(keys) | {"rivals": {}}
    ending, cost, system, scenario = run.ending, run.cost, run.system, run.scenario
    sim, steps = float(run.record["t"][-1]) if len(run.record) else 0.0, max(cost.steps, 1)
    nullspace = nullspace_of(run, truth)
    return {
        "status": ending.status.words,
        "status_time": ending.time,
        "status_signal": ending.signal,
        "status_remedy": ending.status.remedy,
        "n": system.n,
        "velocity_units": list(dict.fromkeys(system.velocity_units)),
        "p": system.p,
        "r": nullspace.r,
        "rank_tolerance": nullspace.tolerance,
        "rank_gap": [float(s) for s in nullspace.gap],
        **found,
        "law": scenario.identifier.name,
        "gains_held": isinstance(scenario.identifier, ConventionalAID),
        "gamma": gamma_of(scenario.identifier),
        "sensors": scenario.sensors,
        "sensor_noise": sensor_noise(run),
        **({"mismatch": list(truth.mismatches), "fault": truth.fault} if truth else {}),
        "faults": [fault.keys() for fault in run.faults],
        **({"stream": run.stream} if run.stream else {}),
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
        "seed": scenario.seed,
        "versions": versions(),
        "scenario_hash": scenario.hash,
    }


def _findings(run: Run, truth: Truth | None) -> dict[str, Any]:
    """The keys that are computed from a record of at least one row."""
    record = run.record
    found: dict[str, Any] = judge(run, "", truth)
    found["conserved_drift"] = conserved_drift(run)
    if truth is not None:
        found["force_residual_floor"] = force_residual_floor(truth)
        found |= lyapunov_figures(run, truth)
    found |= persistence_figures(run, truth)
    found |= motion_figures(run, truth)
    if truth is not None:
        found["assumption_46_margin"], found["least_mass_eigenvalue"] = assumption_46(run, truth)
    found["least_estimated_pivot"] = float(record["pivot"][1:].min()) if len(record) > 1 else None
    found["rivals"] = {
        name: judge(run, name, truth) | {"status": run.statuses[name].words}
        for name in record.rivals
    }
    misfit = misfit_of(run)
    found |= misfit.keys() if misfit else {}
    found["confidence"] = confidence(run, truth, misfit.widening if misfit else 1.0)
    found["parameters"] = parameters(run, truth)
    return found


def parameters(run: Run, truth: Truth | None) -> list[dict[str, Any]]:
    """Name, unit, scale, prior, last estimate and, if known, true value of every parameter."""
    space, estimate = run.system.space, run.record.rows("theta_hat", -1)
    rows: list[dict[str, Any]] = []
    for i, (name, label) in enumerate(zip(space.names, space.labels, strict=True)):
        row: dict[str, Any] = {"name": name, "label": label, "unit": space.units[i]}
        row["scale"] = float(space.scale[i])
        if truth is not None:
            row["true"] = float(truth.theta[i])
        rows.append(row | {"prior": float(run.prior[i]), "estimate": float(estimate[i])})
    return rows


def force_residual_floor(truth: Truth) -> float | None:
    """Share of the actuator forces on a held-out trajectory that no θ of the structure explains.

    0 if the structure describes the plant exactly; None if there is no held-out trajectory.
    """
    if truth.held_out is None:
        return None
    if not truth.mismatches:
        return 0.0
    return residual_floor(truth.system, held_out_rows(truth.system, truth.held_out, None))


def sensor_noise(run: Run) -> str:
    """The sensors' levels with units, in words; empty if the sensors are exact.

    Identifiers use these levels, so they are no mismatch.
    """
    scenario, noise = run.scenario, run.scenario.noise
    if scenario.sensors != "noisy":
        return ""
    rates = dict.fromkeys(run.system.velocity_units)
    velocity, position = " and ".join(rates), " and ".join(u.removesuffix("/s") for u in rates)
    words = f"noise of {rounded(noise.position)} {position}, {rounded(noise.velocity)} {velocity}"
    if noise.encoder_step:
        words += f"; positions quantised to {rounded(noise.encoder_step)} {position}"
    return words


def gamma_of(identifier: IdentifierConfig) -> str:
    """How Γ was chosen: `scale` or `simulated`; `own` by a law from outside the package."""
    if isinstance(identifier, NullspaceAID):
        return identifier.gamma
    return "scale" if isinstance(identifier, ConventionalAID) else "own"


def confidence(run: Run, truth: Truth | None, widening: float = 1.0) -> dict[str, Any] | None:
    """The identifier's stated per-direction standard deviations, compared with the truth if known.

    They are widened by a misfit of the structure; see `misfit`.

    None if the law states no covariance, or if the run was read from its record and no earlier
    summary has it.
    """
    stated = run.identifiers[""].confidence(run.states[""]) if "" in run.states else None
    if stated is None:
        return run.confidence
    from ..watch import widened

    stated = widened(stated, widening)
    theta, space = run.record.rows("theta_hat", -1), run.system.space
    nullspace = nullspace_of(run, None)
    found = known(stated, theta, nullspace, space)
    single = determined(stated, theta, nullspace, space)
    covered: dict[str, float] = {}
    if truth is not None:
        covered["covered"] = found.covered(theta / space.scale, truth.theta / space.scale)
        W = held_out_rows(run.system, truth.held_out, truth.exact)
        if W is not None:
            covered["forces_covered"] = found.forces_covered(theta / space.scale, W * space.scale)
    worst = slice(None, -6, -1)
    return {
        "directions": len(found.deviation),
        "below_noise": int(found.below_noise.sum()),
        **covered,
        "deviation_median": float(np.median(found.deviation)),
        "deviation_largest": float(found.deviation.max()),
        "independent_samples": [float(blocks) for blocks in found.blocks],
        "actuators": {
            space.names[k]: float(s) for k, s in zip(space.actuators, found.actuators, strict=True)
        },
        "parameters": {
            space.names[i]: {"deviation": float(s), "below_noise": bool(low)}
            for i, s, low in zip(single.indices, single.deviation, single.below_noise, strict=True)
        },
        "correlations": _correlations(single, space),
        "worst_known": [
            {
                "deviation": float(s),
                "below_noise": bool(low),
                "parameters": {space.names[i]: float(d[i]) for i in np.argsort(-np.abs(d))[:3]},
            }
            for s, low, d in zip(
                found.deviation[worst],
                found.below_noise[worst],
                found.directions[worst],
                strict=True,
            )
        ],
    }


def _correlations(found: Determined, space: ParameterSpace) -> dict[str, Any]:
    """Names and lower triangle of the correlations: actuators first, links' inertias last."""
    inertial = {
        i for b, s in space if b.geometry == "pseudo_inertia" for i in range(s.start, s.stop)
    }
    order = sorted(
        (n for n, low in enumerate(found.below_noise) if not low and found.deviation[n] > 0),
        key=lambda n: (found.indices[n] not in space.actuators, found.indices[n] in inertial, n),
    )[:_CORRELATED]
    rows = [
        [round(float(r), 3) for r in found.correlation[n, order[:i]]] for i, n in enumerate(order)
    ]
    return {"parameters": [space.names[found.indices[n]] for n in order], "lower": rows}


def versions() -> dict[str, str]:
    """Versions of this package, Python and the dependencies that a run's numbers depend on."""
    own = {"nsaid-mj": version("nsaid-mj"), "python": platform.python_version()}
    return own | {name: found for name in _PACKAGES if (found := _version_of(name))}


@cache
def _version_of(package: str) -> str:
    """Version of an installed package; empty if it is not installed, as some are optional."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
