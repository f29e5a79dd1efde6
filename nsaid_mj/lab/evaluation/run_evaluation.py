"""Evaluates a finished run: every statistic of its `RunResult`."""

import platform
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from ...base import single_threaded
from ...core import (
    ConventionalAID,
    IdentifierConfig,
    Nullspace,
    NullspaceAID,
    ParameterSpace,
    rounded,
)
from ..loop import Run
from .confidence import Determined, determined, known
from .excitation import excitation_of
from .figures import held_out_rows, judge, residual_floor
from .lyapunov import assumption_46, conserved_drift, rises_of
from .run_misfit import misfit_of
from .run_result import RunResult, judged
from .statistics import (
    Conditions,
    Correlations,
    Definiteness,
    Dimensions,
    Estimated,
    KnownDirection,
    KnownParameter,
    LawUsed,
    Origin,
    RivalStatistics,
    RunCost,
    RunEnding,
    StatedConfidence,
    Theory,
    Unobservable,
    finite,
)
from .truth import Truth, nullspace_of

_CORRELATED = 40  # parameters whose correlations are kept, at most
_PACKAGES = ("mujoco", "pin", "numpy", "scipy", "numba", "rerun-sdk", "pyarrow")


@single_threaded
def evaluate(
    run: Run, truth: Truth | None, stated_before: StatedConfidence | None = None
) -> RunResult:
    """Evaluates a run, completed or not; `curves.with_curves` adds what is drawn.

    Without the truth of its plant, statistics that need it are None, and the unobservable
    directions are those at the last estimate.

    Args:
        run: a finished run.
        truth: true parameters of its plant; None if they are unknown.
        stated_before: the confidence of an earlier evaluation, for a run that was read from its
            record, which holds none.
    """
    scenario = run.scenario
    nullspace = nullspace_of(run, truth)
    result = RunResult(
        truth_known=truth is not None,
        recorded=len(run.record) > 0,
        ending=_ending(run),
        dimensions=_dimensions(run, nullspace),
        law=LawUsed(
            law=scenario.identifier.name,
            gains_held=isinstance(scenario.identifier, ConventionalAID),
            gamma=gamma_of(scenario.identifier),
        ),
        conditions=Conditions(
            sensors=scenario.sensors,
            sensor_noise=sensor_noise(run),
            mismatch=None if truth is None else tuple(truth.mismatches),
            fault=None if truth is None else truth.fault,
        ),
        faults=run.faults,
        samples=run.stream,
        unobservable=_unobservable(run, nullspace),
        cost=_cost(run),
        origin=Origin(seed=scenario.seed, versions=versions(), scenario_hash=scenario.hash),
    )
    if result.recorded:
        result = _with_statistics(result, run, truth, stated_before)
    return judged(result, run.system.space)


def _with_statistics(
    result: RunResult, run: Run, truth: Truth | None, stated_before: StatedConfidence | None
) -> RunResult:
    """A result with everything that is computed from a record of at least one row."""
    misfit = misfit_of(run)
    widening = misfit.widening if misfit is not None else 1.0
    return replace(
        result,
        accuracy=judge(run, "", truth),
        theory=_theory(run, truth),
        excitation=excitation_of(run, truth),
        definiteness=_definiteness(run, truth),
        rivals={name: _rival(run, name, truth) for name in run.record.rivals},
        misfit=misfit,
        confidence=confidence_of(run, truth, widening) or stated_before,
        estimates=_estimates(run, truth),
    )


def _ending(run: Run) -> RunEnding:
    ending = run.ending
    return RunEnding(
        status=ending.status.words,
        status_time=ending.time,
        status_signal=ending.signal,
        status_remedy=ending.status.remedy,
    )


def _dimensions(run: Run, nullspace: Nullspace) -> Dimensions:
    system = run.system
    return Dimensions(
        n=system.n,
        velocity_units=tuple(dict.fromkeys(system.velocity_units)),
        p=system.p,
        r=nullspace.r,
        rank_tolerance=nullspace.tolerance,
        rank_gap=tuple(finite(float(s)) for s in nullspace.gap),
    )


def _rival(run: Run, name: str, truth: Truth | None) -> RivalStatistics:
    return RivalStatistics(**vars(judge(run, name, truth)), status=run.statuses[name].words)


def _theory(run: Run, truth: Truth | None) -> Theory:
    drift = finite(conserved_drift(run))
    if truth is None:
        return Theory(conserved_drift=drift)
    rises = rises_of(run, truth)
    return Theory(
        conserved_drift=drift,
        force_residual_floor=finite(force_residual_floor(truth)),
        lyapunov_violations=None if rises is None else rises.violations,
        lyapunov_largest_rise=None if rises is None else finite(rises.largest),
        lyapunov_bound=None if rises is None else finite(rises.bound),
    )


def _definiteness(run: Run, truth: Truth | None) -> Definiteness:
    record = run.record
    margin = None
    least = None
    if truth is not None:
        margin, least = assumption_46(run, truth)
    pivots = record["pivot"][1:]
    stated = np.flatnonzero(pivots)  # `efficient` factorises no M̂ before its first estimate
    pivot = float(pivots[stated[0] :].min()) if len(stated) else None
    return Definiteness(
        assumption_46_margin=finite(margin),
        least_mass_eigenvalue=finite(least),
        least_estimated_pivot=finite(pivot),
    )


def _estimates(run: Run, truth: Truth | None) -> tuple[Estimated, ...]:
    """Name, unit, scale, prior, last estimate and, if known, true value of every parameter."""
    space = run.system.space
    estimate = run.record.rows("theta_hat", -1)
    return tuple(
        Estimated(
            name=name,
            label=space.labels[i],
            unit=space.units[i],
            scale=float(space.scale[i]),
            true=None if truth is None else float(truth.theta[i]),
            prior=float(run.prior[i]),
            estimate=float(estimate[i]),
        )
        for i, name in enumerate(space.names)
    )


def _unobservable(run: Run, nullspace: Nullspace) -> tuple[Unobservable, ...]:
    space = run.system.space
    return tuple(
        Unobservable(
            direction=direction.words,
            fix=direction.fix,
            parameters=tuple(direction.parameters),
            labels=tuple(space.labels[space.index(name)] for name in direction.parameters),
        )
        for direction in nullspace.directions(space)
    )


def _cost(run: Run) -> RunCost:
    cost = run.cost
    steps = max(run.cost.steps, 1)
    simulated = float(run.record["t"][-1]) if len(run.record) else 0.0
    return RunCost(
        wall_s=cost.wall,
        compile_s=cost.compile,
        sim_s=simulated,
        real_time_factor=simulated / cost.wall if cost.wall else 0.0,
        identifier_us_per_step=1e6 * cost.identifier / steps,
        plant_us_per_step=1e6 * cost.plant / steps,
    )


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
    scenario = run.scenario
    noise = run.scenario.noise
    if scenario.sensors != "noisy":
        return ""
    rates = dict.fromkeys(run.system.velocity_units)
    velocity = " and ".join(rates)
    position = " and ".join(u.removesuffix("/s") for u in rates)
    words = f"noise of {rounded(noise.position)} {position}, {rounded(noise.velocity)} {velocity}"
    if noise.encoder_step:
        words += f"; positions quantised to {rounded(noise.encoder_step)} {position}"
    return words


def gamma_of(identifier: IdentifierConfig) -> str:
    """How Γ was chosen: `scale` or `simulated`; `own` by a law from outside the package."""
    if isinstance(identifier, NullspaceAID):
        return identifier.gamma
    return "scale" if isinstance(identifier, ConventionalAID) else "own"


def confidence_of(run: Run, truth: Truth | None, widening: float = 1.0) -> StatedConfidence | None:
    """The identifier's stated per-direction standard deviations, compared with the truth if known.

    They are widened by a misfit of the structure; see `misfit`. None if the law states no
    covariance, or if the run was read from its record.
    """
    stated = run.identifiers[""].confidence(run.states[""]) if "" in run.states else None
    if stated is None:
        return None
    from ...watch import widened

    stated = widened(stated, widening)
    theta = run.record.rows("theta_hat", -1)
    space = run.system.space
    nullspace = nullspace_of(run, None)
    found = known(stated, theta, nullspace, space)
    single = determined(stated, theta, nullspace, space)
    covered = None
    forces_covered = None
    if truth is not None:
        covered = found.covered(theta / space.scale, truth.theta / space.scale)
        W = held_out_rows(run.system, truth.held_out, truth.exact)
        if W is not None:
            forces_covered = found.forces_covered(theta / space.scale, W * space.scale)
    worst = zip(
        found.deviation[_WORST], found.below_noise[_WORST], found.directions[_WORST], strict=True
    )
    return StatedConfidence(
        directions=len(found.deviation),
        below_noise=int(found.below_noise.sum()),
        covered=covered,
        forces_covered=forces_covered,
        deviation_median=float(np.median(found.deviation)),
        deviation_largest=float(found.deviation.max()),
        independent_samples=tuple(finite(float(blocks)) for blocks in found.blocks),
        actuators={
            space.names[k]: finite(float(s))
            for k, s in zip(space.actuators, found.actuators, strict=True)
        },
        parameters={
            space.names[i]: KnownParameter(deviation=finite(float(s)), below_noise=bool(low))
            for i, s, low in zip(single.indices, single.deviation, single.below_noise, strict=True)
        },
        correlations=_correlations(single, space),
        worst_known=tuple(
            KnownDirection(
                deviation=finite(float(s)),
                below_noise=bool(low),
                parameters={space.names[i]: float(d[i]) for i in np.argsort(-np.abs(d))[:3]},
            )
            for s, low, d in worst
        ),
    )


_WORST = slice(None, -6, -1)  # of the directions, the most accurately known first


def _correlations(found: Determined, space: ParameterSpace) -> Correlations:
    """Names and lower triangle of the correlations: actuators first, links' inertias last."""
    inertial = {
        i for b, s in space if b.geometry == "pseudo_inertia" for i in range(s.start, s.stop)
    }
    order = sorted(
        (n for n, low in enumerate(found.below_noise) if not low and found.deviation[n] > 0),
        key=lambda n: (found.indices[n] not in space.actuators, found.indices[n] in inertial, n),
    )[:_CORRELATED]
    return Correlations(
        parameters=tuple(space.names[found.indices[n]] for n in order),
        lower=tuple(
            tuple(finite(round(float(r), 3)) for r in found.correlation[n, order[:i]])
            for i, n in enumerate(order)
        ),
    )


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
