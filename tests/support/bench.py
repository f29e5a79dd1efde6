"""Systems with a truth, motions, and identification step by step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from nsaid_mj.core.laws.base import Estimates, Identifier, State, Status
from nsaid_mj.core.laws.config import IdentifierConfig, NullspaceAID
from nsaid_mj.core.log import Log, Measurement
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.parameters import Array, Block, ParameterSpace
from nsaid_mj.core.structure.parts import Body, Column, Inertia
from nsaid_mj.core.structure.structure import Structure
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab.control.driver import DriverConfig
from nsaid_mj.lab.control.multisine import MultisineCommand
from nsaid_mj.lab.control.pose_hold import PoseHold
from nsaid_mj.lab.control.tracking import FourierTracking
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.vehicles import AstrobeePlant, BlueROV2Plant
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.plant import Plant


@dataclass(frozen=True)
class Bench:
    """A plant with its truth, on a table where the truth may be read.

    Attributes:
        config: what plant.
        dt: its step [s].
        excitation: what drives it.
        law: an identifier whose gains suit it.
    """

    config: PlantConfig
    dt: float
    excitation: DriverConfig
    law: IdentifierConfig

    @cached_property
    def plant(self) -> Plant:
        return self.config.build(self.dt, seed=1)

    @property
    def system(self) -> SecondOrderSystem:
        return self.plant.system

    @property
    def truth(self) -> Array:
        return self.plant.truth

    @cached_property
    def nullspace(self) -> Nullspace:
        return Nullspace.structural(self.system, self.truth, np.random.default_rng(0))

    def prior(self, error: float, seed: int = 2) -> Array:
        """(p,) the truth, off by up to ±error."""
        size = np.maximum(np.abs(self.truth), 0.1 * self.system.space.scale)
        return self.truth + error * size * np.random.default_rng(seed).uniform(-1, 1, len(size))

    def states(self, count: int, seed: int = 3) -> tuple[Array, Array, Array, Array]:
        """(t, x, v, u) of fresh random states, none of which `nullspace` has seen."""
        return random_states(self.system, count, seed)

    def drive(self, seconds: float, seed: int = 4, prior: Array | None = None) -> list[Measurement]:
        """Measurements of MuJoCo's plant under its driver."""
        prior = self.truth if prior is None else prior
        driver = self.excitation.build(self.system, prior, np.random.default_rng(seed))
        with self.plant.running():
            return self.plant.trajectory(driver, round(seconds / self.dt)).rows


BENCHES: dict[str, Callable[[], Bench]] = {
    "scalar_rov": lambda: Bench(
        ScalarRovPlant(net_weight=40.0),
        0.01,
        MultisineCommand(low=0.1, high=1.0),
        NullspaceAID(K=5.0, gain=0.1),
    ),
    "double_pendulum": lambda: Bench(
        ArmPlant("double_pendulum"),
        1e-3,
        FourierTracking(fundamental=0.2),
        NullspaceAID(20.0, 10.0),
    ),
    "ur5": lambda: Bench(
        ArmPlant("ur5", damping=2.0, friction=1.0, armature=0.1),
        1e-3,
        FourierTracking(),
        NullspaceAID(20.0, 1.0),
    ),
    "kinova": lambda: Bench(ArmPlant("kinova"), 1e-3, FourierTracking(), NullspaceAID(20.0, 0.1)),
    "panda": lambda: Bench(ArmPlant("panda"), 1e-3, FourierTracking(), NullspaceAID(20.0, 0.1)),
    "bluerov2": lambda: Bench(
        BlueROV2Plant(), 0.01, MultisineCommand(low=0.1, high=1.0), NullspaceAID(6.0, 0.6)
    ),
    "astrobee": lambda: Bench(AstrobeePlant(), 0.01, PoseHold(), NullspaceAID(1.0, 100.0)),
}
ARMS = ["double_pendulum", "ur5", "kinova", "panda"]


@cache
def bench(name: str) -> Bench:
    """The named bench; built once for all tests."""
    return BENCHES[name]()


def random_states(
    system: SecondOrderSystem, count: int, seed: int
) -> tuple[Array, Array, Array, Array]:
    """(t, x, v, u) of `count` random states."""
    rng = np.random.default_rng(seed)
    q, v, u = (
        np.array(part)
        for part in zip(*(system.random_state(rng) for _ in range(count)), strict=True)
    )
    return rng.uniform(0, 1, count), np.hstack([q, v]), v, u


def identify(law: Identifier, samples: list[Measurement]) -> list[State]:
    """The states of an identifier along measurements, step by step."""
    states = [law.init(samples[0])]
    for previous, now in pairwise(samples):
        states.append(law.step(states[-1], previous, now))
        assert states[-1].status is Status.completed, f"{states[-1].status.words} at {now.t} s"
    return states


def followed(
    law: Identifier, samples: list[Measurement], start: Callable[[State], State] = lambda s: s
) -> tuple[State, Estimates]:
    """The last state and all estimates along measurements, in the law's own loop.

    `start` may alter the first state.
    """
    state, found = law.follow(start(law.init(samples[0])), Log.of(samples))
    assert state.status is Status.completed, f"{state.status.words} after {len(found.pivot)} steps"
    return state, found


def estimates(
    law: Identifier, samples: list[Measurement], start: Callable[[State], State] = lambda s: s
) -> tuple[Array, Array]:
    """(N, n) v̂ and (N, p) θ̂ along measurements."""
    return followed(law, samples, start)[1][:2]


def columns(samples: list[Measurement]) -> tuple[Array, Array, Array, Array]:
    """(t, x, v, u) of measurements, stacked."""
    t, q, v, u = (np.array(part) for part in zip(*samples, strict=True))
    return t, np.hstack([q, v]), v, u


def accelerations(
    system: SecondOrderSystem, t: Array, x: Array, w: Array, u: Array, *, theta: Array
) -> Array:
    """(N, n) v̇(t, x, w, θ) (29) with another θ (N, p) for every sample."""
    return np.array(
        [system.acceleration(*sample) for sample in zip(t, x, w, u, theta, strict=True)]
    )


def lyapunov(
    system: SecondOrderSystem,
    truth: Array,
    Gamma: Array,
    samples: list[Measurement],
    found: tuple[Array, Array],
) -> Array:
    """(N,) V of (66) from v̂ and θ̂, with a diagonal Γ given by its diagonal."""
    _, x, v, _ = columns(samples)
    v_hat, theta_hat = found
    dv = v_hat - v
    M = system.mass_matrix(x, truth)
    return 0.5 * np.einsum("ki,kij,kj->k", dv, M, dv) + 0.5 * np.sum(
        (theta_hat - truth) ** 2 / Gamma, axis=1
    )


def order(steps: Array, errors: Array) -> float:
    """The slope of log error over log step."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


class Motion:
    """A true motion of a system under one held command, known to 1e-12 at every time.

    Nothing in it jumps, so that the order of an integrator can be seen.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        truth: Array,
        q: Array,
        v: Array,
        u: Array,
        *,
        seconds: float,
    ):
        self.system, self.truth, self.u, self.seconds = system, truth, u, seconds
        m = system.m

        def flow(t: float, x: Array) -> Array:
            v = x[m:]
            return np.concatenate([system.J(x[:m]) @ v, system.acceleration(t, x, v, u, truth)])

        solution = solve_ivp(
            flow,
            (0, seconds),
            np.concatenate([q, v]),
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            dense_output=True,
            max_step=0.02,
        )
        self.x = solution.sol

    def samples(self, steps: int) -> list[Measurement]:
        """steps + 1 measurements over the whole motion."""
        m = self.system.m
        return [
            Measurement(float(t), self.x(t)[:m], self.x(t)[m:], self.u)
            for t in np.linspace(0, self.seconds, steps + 1)
        ]


@cache
def swing() -> tuple[Bench, Motion]:
    """A double pendulum with soft friction, let go from the side and pushed by constant torques."""
    table = Bench(
        ArmPlant("double_pendulum", friction_speed=2.0),
        1e-3,
        FourierTracking(),
        NullspaceAID(20.0, 10.0),
    )
    u = np.array([0.05, -0.02])
    return table, Motion(
        table.system, table.truth, np.array([1.5, -0.7]), np.array([0.5, -2.0]), u, seconds=0.8
    )


class TwoVehicles(SecondOrderSystem):
    """Two vehicles (16) that do not touch: θ = [m₁, d₁, g₁, a₁, m₂, d₂, g₂, a₂], r = 2."""

    def __init__(self):
        names = [("mass", "drag", "net weight", "thruster gain"), ("kg", "N·s²/m²", "N", "N")]
        blocks = [
            Block(f"{name} {i}", (f"{name} {i}",), (unit,), np.ones(1), actuator="gain" in name)
            for i in (1, 2)
            for name, unit in zip(*names, strict=True)
        ]
        columns = []
        for i in range(2):
            columns += [
                Column("quadratic", 4 * i + 1, dof=i),
                Column("offset", 4 * i + 2, dof=i, force=-1.0),
                Column("motor", 4 * i + 3, dof=i, input=i),
            ]
        mass = [(i, i, 0, 1.0) for i in range(3)]
        inertias = [Inertia.tied(mass, i, 4 * i) for i in range(2)]
        structure = Structure([Body("slide"), Body("slide")], inertias, columns, 8, 2)
        super().__init__(structure, ParameterSpace(tuple(blocks)))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        return rng.uniform(-1, 1, 2), rng.uniform(-2, 2, 2), rng.uniform(-1, 1, 2)


def simulate(
    system: SecondOrderSystem,
    truth: Array,
    command: Callable[[float], Array],
    dt: float,
    steps: int,
) -> list[Measurement]:
    """Measurements of a system with additive positions, from rest, by RK4 with the command held."""
    q, v, samples = np.zeros(system.m), np.zeros(system.n), []
    for k in range(steps + 1):
        t = k * dt
        u = command(t)
        samples.append(Measurement(t, q, v, u))

        def rate(x: Array, t: float = t, u: Array = u) -> Array:
            v = x[system.m :]
            return np.concatenate([v, system.acceleration(t, x, v, u, truth)])

        x = np.concatenate([q, v])
        k1 = rate(x)
        k2 = rate(x + dt / 2 * k1)
        k3 = rate(x + dt / 2 * k2)
        k4 = rate(x + dt * k3)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        q, v = x[: system.m], x[system.m :]
    return samples
