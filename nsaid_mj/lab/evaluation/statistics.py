"""The statistics of a run, by topic: what summary.json lists, typed.

Every attribute has the name of its key in summary.json. Numbers that are undefined are None, which
JSON writes as null. Those that compare with the truth are None, too, where that is unknown, and
summary.json then leaves their keys out.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

COMPARED = "compared"
"""Mark, in a field's metadata, of a statistic that compares with the truth."""

OPTIONAL = "optional"
"""Mark, in a field's metadata, of a statistic whose key is left out where it is None.

Where it is undefined, it is NaN, and null in summary.json.
"""


def compared() -> Any:
    """The default of a statistic that compares with the truth."""
    return field(default=None, metadata={COMPARED: True})


def optional() -> Any:
    """The default of a statistic whose key is left out of summary.json where it is None."""
    return field(default=None, metadata={OPTIONAL: True})


def finite(value: float | None) -> float | None:
    """A number, or None if it is undefined: NaN or infinite."""
    return None if value is None or not math.isfinite(value) else float(value)


@dataclass(frozen=True, kw_only=True)
class RunEnding:
    """How a run ended.

    Attributes:
        status: `completed`, or how it ended, in words.
        status_time: simulated time at the end [s].
        status_signal: the signal that showed a failure; empty if the run completed.
        status_remedy: what to do about it; empty if the run completed.
    """

    status: str
    status_time: float
    status_signal: str = ""
    status_remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class Dimensions:
    """The size of the problem.

    Attributes:
        n: number of velocities.
        velocity_units: their units, each once.
        p: number of parameters.
        r: dimension of the structural nullspace P_s(θ).
        rank_tolerance: singular value, over the largest, below which a direction counts as
            unobservable.
        rank_gap: smallest singular value above the tolerance, and largest below it.
    """

    n: int
    velocity_units: tuple[str, ...]
    p: int
    r: int
    rank_tolerance: float
    rank_gap: tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """How good an identifier's last estimate is.

    Attributes:
        theta_perp_ratio: distance to the true set, ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ with θ_s = θ/scale.
        theta_perp_ratio_initial: the same of the prior.
        plant_direction_error: sine of the angle between estimated and true plant parameters.
        actuator_ratio_error: max |(k̂_i/k_i)/mean(k̂/k) − 1| over the actuators.
        force_residual_ratio: rms of W θ̂ over rms of the actuator forces, on a held-out trajectory.
        force_residual_ratio_measured: the same over the last tenth of the run itself, where the
            truth is unknown and the record has every command.
        velocity_error_rms: rms Δv over the last tenth of the run [SI].
    """

    theta_perp_ratio: float | None = compared()
    theta_perp_ratio_initial: float | None = compared()
    plant_direction_error: float | None = compared()
    actuator_ratio_error: float | None = compared()
    force_residual_ratio: float | None = compared()
    force_residual_ratio_measured: float | None = optional()
    velocity_error_rms: float | None = None

    @property
    def force_residual(self) -> float | None:
        """The force residual on a held-out trajectory, or else over the run's own last tenth."""
        if self.force_residual_ratio is not None:
            return self.force_residual_ratio
        return finite(self.force_residual_ratio_measured)


@dataclass(frozen=True, kw_only=True)
class RivalStatistics(Accuracy):
    """How good the last estimate of another identifier of the same run is.

    Attributes:
        status: how that identifier ended, in words.
    """

    status: str = ""


@dataclass(frozen=True, kw_only=True)
class Theory:
    """Quantities of the paper's proofs.

    Attributes:
        conserved_drift: largest relative drift of θ̂ᵀ Γ⁻¹ θ̂; None for a law that conserves nothing.
        force_residual_floor: smallest force residual on the held-out trajectory of any θ.
        lyapunov_violations: time steps in which V rose by more than the integrator's error bound;
            None, as the two others, for a law without a proof.
        lyapunov_largest_rise: largest rise of V in a time step, over V(0).
        lyapunov_bound: largest rise that integrator and memory explain, over V(0).
    """

    conserved_drift: float | None = None
    force_residual_floor: float | None = compared()
    lyapunov_violations: int | None = compared()
    lyapunov_largest_rise: float | None = compared()
    lyapunov_bound: float | None = compared()


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Excitation by the motion, and decay of the errors that it makes observable.

    Attributes:
        pe_level: smallest ε₀ of (2) over the run's windows [N·m·s]; 0 if there is no window.
        pe_level_perp: smallest ε₀ of (75) [N·m·s].
        pe_share_perp: smallest ratio of a window's ε₀ of (75) to its total excitation; None if no
            window has enough rows.
        r_excited: number of directions that the motion leaves unexcited.
        velocity_error_rms_initial: rms Δv over the first tenth of the run [SI], see (70).
        excited_error_rms_initial: rms W(t, x, v, θ) θ̂ over the first tenth of the run, see (74).
        excited_error_rms: the same over the last tenth.
    """

    pe_level: float | None = None
    pe_level_perp: float | None = compared()
    pe_share_perp: float | None = compared()
    r_excited: int | None = compared()
    velocity_error_rms_initial: float | None = None
    excited_error_rms_initial: float | None = compared()
    excited_error_rms: float | None = compared()


@dataclass(frozen=True, kw_only=True)
class Definiteness:
    """How far the mass matrices of the run were from losing definiteness.

    Attributes:
        assumption_46_margin: margin of assumption (46) [SI], negative if it is violated; None for a
            law without a constant Γ.
        least_mass_eigenvalue: smallest λ_min(M(x, θ)) over the run [SI].
        least_estimated_pivot: smallest pivot of M̂ in any step from the law's first estimate on
            [SI]; 0 if M̂ was not positive definite, None if none was factored.
    """

    assumption_46_margin: float | None = compared()
    least_mass_eigenvalue: float | None = compared()
    least_estimated_pivot: float | None = None


@dataclass(frozen=True, kw_only=True)
class KnownParameter:
    """How well a parameter is known by itself, at a fixed mean of the gains.

    Attributes:
        deviation: standard deviation, in its unit.
        below_noise: whether it is known hardly better than before the data.
    """

    deviation: float | None
    below_noise: bool


@dataclass(frozen=True, kw_only=True)
class Correlations:
    """Correlations of the errors of single parameters.

    Attributes:
        parameters: names, actuators first.
        lower: rows of the lower triangle, without the diagonal.
    """

    parameters: tuple[str, ...] = ()
    lower: tuple[tuple[float | None, ...], ...] = ()


@dataclass(frozen=True, kw_only=True)
class KnownDirection:
    """How well one observable direction is known.

    Attributes:
        deviation: standard deviation along it, over ‖θ̂/scale‖.
        below_noise: whether it is known hardly better than before the data.
        parameters: its three largest components in θ/scale, by the parameter's name.
    """

    deviation: float | None
    below_noise: bool
    parameters: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class StatedConfidence:
    """The confidence that a law states at the end, widened by a misfit of the structure.

    Attributes:
        directions: number of observable directions.
        below_noise: number of those that are known hardly better than before the data.
        covered: share of the directions whose 95 % interval contains the truth.
        forces_covered: share of the forces on a held-out motion that are within the 95 % intervals
            of their predictions.
        deviation_median: median of the directions' standard deviations, over ‖θ̂/scale‖.
        deviation_largest: the largest of them.
        independent_samples: effective number of samples per row of the momentum balance.
        actuators: relative standard deviation of each gain over the mean of all, by name.
        parameters: of the parameters that are determined by themselves, by name.
        correlations: of the errors of these.
        worst_known: the least known directions, the worst first.
    """

    directions: int
    below_noise: int
    covered: float | None = optional()
    forces_covered: float | None = optional()
    deviation_median: float
    deviation_largest: float
    independent_samples: tuple[float | None, ...]
    actuators: Mapping[str, float | None]
    parameters: Mapping[str, KnownParameter]
    correlations: Correlations
    worst_known: tuple[KnownDirection, ...]


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """A parameter of θ in its own scale, which no motion reveals.

    Attributes:
        name: short name.
        label: in words.
        unit: SI unit.
        scale: what an engineer would guess of its size beforehand.
        true: the plant's value.
        prior: value before the run.
        estimate: value at its end.
    """

    name: str
    label: str
    unit: str
    scale: float
    true: float | None = compared()
    prior: float
    estimate: float


@dataclass(frozen=True, kw_only=True)
class LawUsed:
    """The law of a run.

    Attributes:
        law: `paper`, `cone`, `memory` or `efficient`.
        gains_held: whether it holds parameters, such as the gains, at their prior values.
        gamma: how Γ was chosen: `scale` or `simulated`.
    """

    law: str
    gains_held: bool = False
    gamma: str = "scale"


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """What was simulated beside the structure.

    Attributes:
        sensors: `ideal` or `noisy`.
        sensor_noise: the sensors' levels with units, in words; empty if they are exact.
        mismatch: effects in the plant that the structure does not model, in words.
        fault: faults in the plant, in words; empty if there are none.
    """

    sensors: str
    sensor_noise: str = ""
    mismatch: tuple[str, ...] | None = compared()
    fault: str | None = compared()


@dataclass(frozen=True, kw_only=True)
class Unobservable:
    """One direction of P_s(θ).

    Attributes:
        direction: the change that has no effect on the motion, in words.
        fix: what one known number would determine, in words.
        parameters: names of the parameters involved, the leading one first.
        labels: the same in words.
    """

    direction: str
    fix: str
    parameters: tuple[str, ...]
    labels: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class RunCost:
    """Computing times.

    Attributes:
        wall_s: wall time of the loop [s].
        compile_s: time spent compiling kernels [s].
        sim_s: simulated time [s].
        real_time_factor: simulated over wall time.
        identifier_us_per_step: time of the identifiers per time step [µs].
        plant_us_per_step: time of the plant per time step [µs].
    """

    wall_s: float
    compile_s: float
    sim_s: float
    real_time_factor: float
    identifier_us_per_step: float
    plant_us_per_step: float


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What is needed to run it again, to the bit.

    Attributes:
        seed: the scenario's seed.
        versions: of this package, Python and the dependencies that a run's numbers depend on.
        scenario_hash: digest of the scenario.
    """

    seed: int
    versions: Mapping[str, str]
    scenario_hash: str
