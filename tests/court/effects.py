"""Effects that the identifier's structure does not know, in sizes from invisible to gross.

Lag, delay and flow are the package's own mismatch, sag and drift its slow losses, so that their
truth at the end is known. The others change the command, the force on a joint, MuJoCo's model, or
what the sensors measure. A rotor behind an elastic transmission, with or without backlash, is
integrated here beside MuJoCo; the encoder sits on the rotor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.plants.world.faults.kinds import Fault, Loss, Payload, gains_of
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.plant import Plant

from .sensors import Errors


class Effect(NamedTuple):
    """An effect.

    Attributes:
        sizes: from invisible to gross; in words what they are is `unit`.
        unit: of the sizes.
        robots: kinds of robots that can have it.
        substeps: of MuJoCo that it needs in 2 ms.
    """

    sizes: tuple[float, ...]
    unit: str
    robots: tuple[str, ...]
    substeps: int = 1


_ARM, _ALL = ("arm",), ("arm", "rov", "torpedo", "quad", "car", "space")
_LINEAR = ("arm", "rov", "space")

EFFECTS = {
    "lag": Effect((0.5, 1.5, 5.0, 15.0, 50.0), "time steps", _ALL),
    "delay": Effect((1, 2, 5, 10, 25), "time steps", _ALL),
    "current": Effect((0.001, 0.005, 0.02, 0.1, 0.3), "m/s", ("rov", "torpedo")),
    "wind": Effect((0.01, 0.05, 0.2, 1.0, 3.0), "m/s", ("quad",)),
    "dead zone": Effect((0.0005, 0.003, 0.01, 0.05, 0.2), "of the rms command", _LINEAR),
    "curve": Effect((0.001, 0.005, 0.02, 0.1, 0.3), "cubic share", _ALL),
    "reverse gain": Effect((0.0005, 0.002, 0.01, 0.05, 0.3), "weaker", ("arm", "rov")),
    "sag": Effect((0.001, 0.01, 0.03, 0.1, 0.3), "per minute", _ALL),
    "drift": Effect((0.001, 0.01, 0.03, 0.1, 0.3), "per minute", _ALL),
    "stribeck": Effect((0.01, 0.05, 0.2, 0.5, 1.5), "of Coulomb friction", _ARM, 4),
    "asymmetric friction": Effect((0.005, 0.02, 0.1, 0.3, 0.8), "of Coulomb friction", _ARM, 4),
    "elastic": Effect((200.0, 100.0, 50.0, 25.0, 12.0), "Hz, rotor's resonance", _ARM, 8),
    "backlash": Effect((1e-4, 5e-4, 2e-3, 1e-2, 3e-2), "rad or m", _ARM, 8),
    "mount": Effect((0.02, 0.1, 0.5, 3.0, 20.0), "degrees", _ARM),
    "gear": Effect((5e-4, 2e-3, 1e-2, 0.1, 1.0), "ratio's error, one joint", _ARM),
    "zero error": Effect((0.005, 0.02, 0.05, 0.2, 1.0), "degrees", _ARM),
    "jitter": Effect((0.02, 0.1, 0.3, 0.6, 0.9), "of a time step", _ALL),
    "held": Effect((2, 3, 5, 10, 20), "samples, logged commands", _ALL),
    "noise": Effect((0.3, 0.5, 2.0, 4.0, 10.0), "true over stated noise", _ALL),
    "loss": Effect((0.1, 0.4), "a true fault", _ALL),
    "payload": Effect((0.1, 0.5), "of the last body's mass, a true fault", ("arm", "rov")),
}
FAULTS = ("loss", "payload")
"""True faults, which a run should name."""
_FADING = ("sag", "drift")


def mismatch_of(name: str, size: float, dt: float, rng: np.random.Generator) -> Mismatch:
    """The package's mismatch that an effect is; none for others."""
    if name == "lag":
        return Mismatch(lag=float(size * dt))
    if name == "delay":
        return Mismatch(delay=float(size * dt))
    if name in ("current", "wind"):
        way = rng.standard_normal(3) * (1, 1, 0.3)
        x, y, z = (size * way / np.linalg.norm(way)).tolist()
        return Mismatch(flow=(x, y, z))
    return Mismatch()


def faults_of(
    name: str, size: float, plant: Plant, duration: float, rng: np.random.Generator
) -> tuple[Fault, ...]:
    """The package's faults that an effect is: true ones at half the time, or gains that fade."""
    system = plant.system
    sound = [k + 1 for k in range(system.n_u) if _gains(system, k + 1)]
    if name in _FADING:
        hit = sound if name == "sag" else [int(rng.choice(sound))]
        share = min(0.95, size * (duration + 10.0) / 60.0)
        return tuple(Loss(actuator=k, share=share, rate=size / 60.0) for k in hit)
    if name == "loss":
        return (Loss(actuator=int(rng.choice(sound)), share=size, time=duration / 2),)
    if name == "payload":
        names = [block.names[0] for block, _ in system.space if block.geometry == "pseudo_inertia"]
        mass = float(plant.truth[system.space.index([system.space.names[0], *names][-1])])
        place = tuple(float(x) for x in 0.05 * rng.uniform(-1, 1, 3))
        return (Payload(mass=size * mass, place=place, time=duration / 2),)  # type: ignore[arg-type]
    return ()


def _gains(system: Any, actuator: int) -> bool:
    try:
        return bool(gains_of(system, actuator).size)
    except Exception:
        return False


def errors_of(name: str, size: float, n: int, rng: np.random.Generator) -> Errors:
    """The errors of the sensors that an effect is."""
    if name == "zero error":
        return Errors(zero=np.deg2rad(size) * rng.choice([-1.0, 1.0], n))
    if name == "gear":
        ratio = np.ones(n)
        ratio[rng.integers(n)] += size
        return Errors(ratio=ratio)
    if name == "held":
        return Errors(held=int(size))
    if name == "noise":
        return Errors(noise=size)
    return Errors(jitter=size if name == "jitter" else 0.0)


def change_command(name: str, size: float, typical: Array) -> Callable[[Array], Array] | None:
    """What an effect makes of a command (n_u,) whose rms is (n_u,); None if nothing."""
    if name == "dead zone":
        edge = size * typical
        return lambda u: np.sign(u) * np.maximum(np.abs(u) - edge, 0.0)
    if name == "curve":
        return lambda u: u * (1 + size * ((u / typical) ** 2 - 1))
    if name == "reverse gain":
        return lambda u: np.where(u < 0, (1 - size) * u, u)
    return None


def tilt_gravity(plant: Plant, degrees: float, rng: np.random.Generator) -> None:
    """Turns gravity about a random axis: the robot is mounted askew."""
    g = plant.model.opt.gravity.copy()
    axis = np.cross(g, rng.standard_normal(3))
    axis /= np.linalg.norm(axis)
    angle = np.deg2rad(degrees)
    plant.model.opt.gravity[:] = np.cos(angle) * g + np.sin(angle) * np.cross(axis, g)


@dataclass
class Stepper:
    """Advances a plant with changed commands and additional forces; takes the place of its `step`.

    Attributes:
        plant: the plant.
        change: of the commands; None for none.
        force: (nv,) on the joints at every step of MuJoCo, or None; it may return the command that
            MuJoCo's actuators still exert.
    """

    plant: Plant
    change: Callable[[Array], Array] | None = None
    force: Callable[[Array, float], tuple[Array, Array]] | None = None

    def __call__(self, u: Array) -> None:
        """One time step with the command u (n_u,) held."""
        plant = self.plant
        if self.change is not None:
            u = self.change(np.asarray(u))
        if self.force is None:
            type(plant).step(plant, u)
            return
        data, model = plant.data, plant.model
        for _ in range(plant.substeps):
            data.qfrc_applied[:], data.ctrl[:] = self.force(u, model.opt.timestep)
            mujoco.mj_step(model, data)


def _true(plant: Any, block: str) -> Array:
    """(k,) a block of an arm's true parameters."""
    return plant.truth[plant.system.space[block]]


def friction_force(
    plant: Any, name: str, size: float
) -> Callable[[Array, float], tuple[Array, Array]]:
    """Stribeck's additional friction at low speed, or friction that differs between directions."""
    at, coulomb = plant.joints.motors, _true(plant, "Coulomb friction")
    speed = plant.system.friction_speed

    def force(u: Array, h: float) -> tuple[Array, Array]:
        v, found = plant.data.qvel[at], np.zeros(plant.model.nv)
        if name == "stribeck":
            found[at] = -size * coulomb * np.tanh(v / speed) * np.exp(-((v / (4 * speed)) ** 2))
        else:
            found[at] = -size * coulomb * np.abs(np.tanh(v / speed))
        return found, u

    return force


class Transmission:
    """Rotors behind springs of a given resonance, with backlash; friction stays on the links.

    Args:
        plant: an arm whose θ holds rotor inertias; they are taken from its links.
        errors: of the sensors, which receive the deflection: encoders sit on the rotors.
        resonance: of every rotor on its spring [Hz].
        gap: half the backlash [rad or m].
    """

    def __init__(self, plant: Any, errors: Errors, resonance: float, gap: float):
        self._plant, self._errors, self._gap = plant, errors, gap
        self._rotor = _true(plant, "rotor inertia")
        self._gain = _true(plant, "motor gain")
        self._at, self._places = plant.joints.motors, plant.joints.qpos
        omega = 2 * np.pi * resonance
        self._spring, self._damper = self._rotor * omega**2, self._rotor * 2 * 0.1 * omega
        plant.model.dof_armature[self._at] = 0.0
        self._angle = np.zeros(0)

    def reset(self) -> None:
        """Rotors where the links are."""
        self._angle, self._rate = self._link()
        self._errors.deflection[:] = [0.0, 0.0]

    def _link(self) -> tuple[Array, Array]:
        data = self._plant.data
        return data.qpos[self._places], data.qvel[self._at]

    def __call__(self, u: Array, h: float) -> tuple[Array, Array]:
        """(nv,) forces on the links and (n_u,) commands, now 0, for one step of h seconds."""
        position, velocity = self._link()
        twist = self._angle - position
        twist = np.sign(twist) * np.maximum(np.abs(twist) - self._gap, 0.0)
        torque = self._spring * twist + self._damper * (self._rate - velocity) * (twist != 0)
        self._rate = self._rate + h * (self._gain * u - torque) / self._rotor
        self._angle = self._angle + h * self._rate
        self._errors.deflection[:] = [self._angle - position, self._rate - velocity]
        found = np.zeros(self._plant.model.nv)
        found[self._at] = torque
        return found, np.zeros(len(u))
