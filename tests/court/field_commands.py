"""Logs with the commands that people have: targets under a known PD law, commands that never move,
coupled joints.

Each `draw_…(seed, folder)` simulates a robot that differs from its model file and writes what a
user would bring: the model, logs, a map where one is needed, and apart from them the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.sensors import Sensors
from nsaid_mj.lab.setup import Setup

Array = np.ndarray

_STEP = 5e-4  # of the simulation [s]


@dataclass
class Drawn:
    """What a user has, and what is true.

    Attributes:
        kind: what the log stands for.
        model: the user's model file.
        logs: files.
        map: map.toml; None if the names tell.
        truth: values by the labels of `nsaid identify`.
    """

    kind: str
    model: Path
    logs: list[Path]
    map: Path | None
    truth: dict[str, float] = field(default_factory=dict)


# -- motors under a PD law ------------------------------------------------------------------------


_LEG = (
    '<body name="{0}_hip" pos="{1} 0 0"><joint name="{0}_hip_joint" axis="1 0 0"/>'
    '<inertial pos="0 .04 0" mass="{2}" diaginertia="8e-4 6e-4 7e-4"/>'
    '<body pos="0 .08 0"><joint name="{0}_thigh_joint" axis="0 1 0"/>'
    '<inertial pos="0 0 -.08" mass="{3}" diaginertia="7e-3 7e-3 2e-3"/>'
    '<body pos="0 0 -.25"><joint name="{0}_calf_joint" axis="0 1 0"/>'
    '<inertial pos="0 0 -.1" mass="{4}" diaginertia="3e-3 3e-3 2e-4"/></body></body></body>'
)
_LEGS = ("FL", "FR")
_PARTS = ("hip", "thigh", "calf")


def _legs(masses: Array, joint: dict[str, Array], gain: Array) -> str:
    """MJCF of two legs on a stand, with (2, 3) masses and (6,) numbers of joints and motors."""
    body = "".join(
        _LEG.format(leg, x, *own) for leg, x, own in zip(_LEGS, (0.2, -0.2), masses, strict=True)
    )
    names = [f"{leg}_{part}" for leg in _LEGS for part in _PARTS]
    for k, name in enumerate(names):
        own = " ".join(f'{key}="{values[k]:.6g}"' for key, values in joint.items())
        body = body.replace(f'name="{name}_joint"', f'name="{name}_joint" {own}')
    motors = "".join(
        f'<motor name="{n}" joint="{n}_joint" gear="{g:.6g}"/>'
        for n, g in zip(names, gain, strict=True)
    )
    return (
        f'<mujoco model="legs"><compiler angle="radian"/><option timestep="{_STEP}" '
        f'integrator="implicitfast"/><worldbody>{body}</worldbody><actuator>{motors}</actuator>'
        "</mujoco>"
    )


def _followed(
    mj: mujoco.MjModel, issued: Array, gains: tuple[float, float], every: int, late: int
) -> tuple[Array, Array]:
    """(N, n) q and v of motors under a PD law with what its targets issue (N, n), held and late."""
    kp, kd = gains
    data = mujoco.MjData(mj)
    data.qpos[:] = issued[0] / kp
    q = np.empty(issued.shape)
    v = np.empty(issued.shape)
    for k in range(len(issued) * every):
        if k % every == 0:
            q[k // every] = data.qpos
            v[k // every] = data.qvel
        data.ctrl[:] = issued[max(0, k - late) // every] - kp * data.qpos - kd * data.qvel
        mujoco.mj_step(mj, data)
    return q, v


def draw_pd(seed: int, folder: Path, duration: float = 30.0) -> Drawn:
    """Legs on a stand whose motors follow a policy's targets by a PD law, at 1 kHz or more."""
    rng = np.random.default_rng([seed, 1])
    masses = np.tile([1.0, 1.5, 0.4], (2, 1))
    n = 6
    stock = {"damping": np.full(n, 0.1), "frictionloss": np.full(n, 0.2)}
    stock["armature"] = np.full(n, 0.01)
    true = {
        "damping": rng.uniform(0.02, 0.3, n),
        "frictionloss": rng.uniform(0.05, 0.4, n),
        "armature": rng.uniform(0.005, 0.03, n),
    }
    gain = rng.uniform(0.8, 1.2, n)
    kp = rng.choice([20.0, 30.0, 60.0])
    kd = rng.choice([0.5, 1.0, 1.5])
    mj = mujoco.MjModel.from_xml_string(_legs(masses * rng.uniform(0.9, 1.1, (2, 3)), true, gain))
    rate = float(rng.choice([50.0, 100.0, 200.0, 500.0]))  # of the log and the targets' updates
    delay = float(rng.choice([0.0, 0.005, 0.01]))
    with_rates = bool(rng.random() < 0.3)
    with_forward = bool(rng.random() < 0.3)
    every = round(1 / (rate * _STEP))
    rows = round(duration * rate)
    t = np.arange(rows) / rate
    f = rng.uniform(0.2, 2.0, (3, n))
    phase = rng.uniform(0, 2 * np.pi, (3, n))
    size = rng.uniform(0.1, 0.35, n)
    angles = 2 * np.pi * f * t[:, None, None] + phase
    target = (size * np.sin(angles)).sum(axis=1) + rng.uniform(-0.3, 0.3, n)
    target += 0.02 * rng.standard_normal(target.shape)  # a policy is not smooth
    wanted = (size * 2 * np.pi * f * np.cos(angles)).sum(axis=1) * with_rates
    forward = 0.5 * np.sin(2 * np.pi * 0.3 * t[:, None] + phase[0]) * with_forward
    issued = kp * target + kd * wanted + forward
    q, v = _followed(mj, issued, (kp, kd), every, round(delay / _STEP))
    q += 2e-4 * rng.standard_normal(q.shape)
    v += 1e-2 * rng.standard_normal(v.shape)
    names = [f"{leg}_{part}" for leg in _LEGS for part in _PARTS]
    groups = {"q": q, "dq": v, "q_des": target}
    groups |= {"dq_des": wanted} if with_rates else {}
    groups |= {"tau_ff": forward} if with_forward else {}
    header = ["t", *(f"{group}_{name}" for group in groups for name in names)]
    log = folder / f"pd_{seed}.csv"
    table = np.column_stack([t, *groups.values()])
    np.savetxt(log, table, delimiter=",", header=",".join(header), comments="", fmt="%.7g")
    model = folder / f"pd_{seed}.xml"
    model.write_text(_legs(masses, stock, np.ones(n)), encoding="utf-8")
    chosen = folder / f"pd_{seed}.toml"
    chosen.write_text(f"[pd]\nkp = {kp}\nkd = {kd}\n", encoding="utf-8")
    truth = {}
    for k, name in enumerate(names):
        truth[f"gain of {name}_joint"] = gain[k]
        truth[f"rotor inertia of {name}_joint"] = true["armature"][k]
        truth[f"viscous friction of {name}_joint"] = true["damping"][k]
        truth[f"Coulomb friction of {name}_joint"] = true["frictionloss"][k]
    return Drawn("pd", model, [log], chosen, truth)


# -- a command that never moves -------------------------------------------------------------------


class Frozen(Driver):
    """A vehicle's driver whose command of one actuator is a constant."""

    def __init__(self, driver: Driver, actuator: int, value: float):
        self._driver = driver
        self._actuator = actuator
        self._value = value

    def start(self) -> tuple[Array, Array]:
        """That of the driver."""
        return self._driver.start()

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) the driver's command, with one that never moves."""
        u = np.array(self._driver.command(t, q, v))
        u[self._actuator] = self._value
        return u


_STEERED = {"remus100": (0, 0.7), "bluerov2": (4, 0.3), "catamaran": (0, 0.5), "f1tenth": (0, 0.4)}
"""Vehicles, with the actuator that may be constant and its typical command."""


def draw_constant(seed: int, folder: Path, duration: float = 40.0, vehicle: str = "") -> Drawn:
    """A vehicle of which one command never moves: often a propeller while the rudder works."""
    rng = np.random.default_rng([seed, 2])
    name = vehicle or str(rng.choice(list(_STEERED)))
    actuator, typical = _STEERED[name]
    scenario = replace(
        load(name),
        duration=duration,
        sensors="noisy",
        seed=int(rng.integers(2**31)),
        record_every=1,
    )
    setup = Setup.of(scenario)
    with setup.plant.running():
        driver = Frozen(setup.driver(), actuator, typical * float(rng.uniform(0.7, 1.3)))
        sensors = Sensors(scenario.noise, np.random.default_rng(setup.seeds.sensors))
        first = setup.plant.begin(driver, sensors)
        log = setup.plant.drive(driver, first, round(duration / scenario.dt), sensors)
    parts = {"q": log.q, "v": log.v, "u": log.u}
    header = ["t", *(f"{x}_{k}" for x, own in parts.items() for k in range(own.shape[1]))]
    every = max(1, round(0.02 / scenario.dt))
    path = folder / f"constant_{seed}.csv"
    table = np.column_stack([log.t, *parts.values()])[::every]
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.9g")
    truth = dict(zip(setup.system.space.labels, setup.plant.truth.tolist(), strict=True))
    return Drawn("constant", Path(name), [path], None, truth)


# -- coupled joints -------------------------------------------------------------------------------


_ARM = (
    '<body name="upper" pos="0 0 .5"><joint name="shoulder" axis="0 1 0" {0}/>'
    '<inertial pos="{6} 0 -.15" mass="{3}" diaginertia=".02 .02 .003"/>'
    '<body name="fore" pos="0 0 -.3"><joint name="elbow" axis="0 1 0" {1}/>'
    '<inertial pos="0 .02 -.1" mass="{4}" diaginertia=".008 .008 .001"/>'
    '<body name="hand" pos="0 0 -.25"><joint name="wrist" axis="0 1 0" {2}/>'
    '<inertial pos=".02 0 -.06" mass="{5}" diaginertia=".002 .002 .0004"/></body></body></body>'
)


def draw_coupled(seed: int, folder: Path, duration: float = 30.0, urdf: bool = False) -> Drawn:
    """An arm whose wrist follows the elbow (a parallelogram or a belt), by torque."""
    rng = np.random.default_rng([seed, 3])
    ratio = float(rng.choice([-1.0, 0.5, -0.7, 1.5]))
    offset = float(rng.choice([0.0, 0.2, -0.3]))
    masses = np.array([2.0, 1.2, 0.6])
    true = {
        "damping": rng.uniform(0.05, 0.4, 3),
        "frictionloss": rng.uniform(0.05, 0.5, 3),
        "armature": rng.uniform(0.005, 0.03, 3),
    }
    gain = rng.uniform(0.7, 1.3, 2)

    def arm(masses: Array, x: float, joint: dict[str, Array]) -> str:
        own = [" ".join(f'{key}="{v[k]:.6g}"' for key, v in joint.items()) for k in range(3)]
        return (
            '<mujoco model="coupled"><compiler angle="radian"/><option timestep="5e-4" '
            'integrator="implicitfast"/><worldbody>'
            + _ARM.format(*own, *masses, x)
            + '</worldbody><equality><joint joint1="wrist" joint2="elbow" '
            f'polycoef="{offset} {ratio} 0 0 0" solref="2e-3 1" solimp=".9999 .9999 1e-3"/>'
            '</equality><actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator>'
            "</mujoco>"
        )

    rate = 250.0
    mj = mujoco.MjModel.from_xml_string(arm(masses * rng.uniform(0.8, 1.2, 3), 0.01, true))
    rows = round(duration * rate)
    t = np.arange(rows) / rate
    angles = 2 * np.pi * rng.uniform(0.2, 1.2, (3, 2)) * t[:, None, None]
    target = 0.3 * np.sin(angles + rng.uniform(0, 2 * np.pi, (3, 2))).sum(axis=1)
    every = round(1 / (rate * 5e-4))
    data = mujoco.MjData(mj)
    data.qpos[:] = [*target[0], offset + ratio * target[0, 1]]
    q = np.empty((rows, 2))
    u = np.empty((rows, 2))
    for k in range(rows):
        force = np.array([60.0, 30.0]) * (target[k] - data.qpos[:2])
        u[k] = (force - np.array([4.0, 2.0]) * data.qvel[:2]) / gain
        q[k] = data.qpos[:2]
        data.ctrl[:] = gain * u[k]
        mujoco.mj_step(mj, data, every)
    q += 1e-4 * rng.standard_normal(q.shape)
    log = folder / f"coupled_{seed}.csv"
    names = ["t", "shoulder_position", "elbow_position", "shoulder_torque", "elbow_torque"]
    table = np.column_stack([t, q, u])
    np.savetxt(log, table, delimiter=",", header=",".join(names), comments="", fmt="%.7g")
    stock = {"damping": np.full(3, 0.1), "frictionloss": np.full(3, 0.2)}
    stock["armature"] = np.full(3, 0.01)
    model = folder / f"coupled_{seed}.xml"
    model.write_text(arm(masses, 0.0, stock), encoding="utf-8")
    if urdf:
        model = folder / f"coupled_{seed}.urdf"
        model.write_text(_mimic_urdf(masses, ratio, offset), encoding="utf-8")
    truth = {}
    factors = {"damping": ratio**2, "frictionloss": abs(ratio), "armature": ratio**2}
    labels = {"damping": "viscous friction", "frictionloss": "Coulomb friction"}
    labels["armature"] = "rotor inertia"
    for key, label in labels.items():
        truth[f"{label} of shoulder"] = true[key][0]
        truth[f"{label} of elbow"] = true[key][1] + factors[key] * true[key][2]
    truth |= {"gain of shoulder": gain[0], "gain of elbow": gain[1]}
    return Drawn("coupled", model, [log], None, truth)


def _mimic_urdf(masses: Array, ratio: float, offset: float) -> str:
    """The arm's URDF, whose wrist is a <mimic> of the elbow."""
    parts = ["shoulder", "elbow", "wrist"]
    links = ["base", "upper", "fore", "hand"]
    places = ["0 0 .5", "0 0 -.3", "0 0 -.25"]
    centres = ["0 0 -.15", "0 .02 -.1", ".02 0 -.06"]
    moments = [(0.02, 0.003), (0.008, 0.001), (0.002, 0.0004)]
    text = '<robot name="coupled"><link name="base"/>'
    for k, (long, short) in enumerate(moments):
        text += (
            f'<link name="{links[k + 1]}"><inertial><origin xyz="{centres[k]}"/><mass '
            f'value="{masses[k]}"/><inertia ixx="{long}" iyy="{long}" izz="{short}" ixy="0" '
            'ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{parts[k]}" type="revolute"><parent link="{links[k]}"/><child '
            f'link="{links[k + 1]}"/><origin xyz="{places[k]}"/><axis xyz="0 1 0"/><limit '
            'lower="-3" upper="3" effort="100" velocity="10"/>'
        )
        if k == 2:
            text += f'<mimic joint="elbow" multiplier="{ratio}" offset="{offset}"/>'
        text += "</joint>"
    return text + "</robot>"


# -- curves of thrusters --------------------------------------------------------------------------


class Curved(Driver):
    """A ROV's driver whose thrusters have another curve than the plant's: it commands what acts."""

    def __init__(self, driver: Driver, acting: Callable[[Array], Array]):
        self._driver = driver
        self._acting = acting

    def start(self) -> tuple[Array, Array]:
        """That of the driver."""
        return self._driver.start()

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) commands with which the plant's curve gives the forces of the true one."""
        return self._acting(np.array(self._driver.command(t, q, v)))


def draw_curve(seed: int, folder: Path, duration: float = 40.0) -> Drawn:
    """A BlueROV2 whose thrusters have a dead zone, an exponent and a weaker reverse."""
    rng = np.random.default_rng([seed, 4])
    dead = float(rng.uniform(0.02, 0.12))
    exponent = float(rng.uniform(1.3, 2.0))
    reverse = float(rng.uniform(0.85, 1.0))
    scenario = replace(
        load("bluerov2"), duration=duration, sensors="noisy", seed=int(rng.integers(2**31))
    )
    setup = Setup.of(scenario)
    grid = np.linspace(0.0, 1.0, 2001)
    curve = np.asarray(setup.system.columns("thruster")[0].constants["curve"])[1:]
    sheet = sum(c * grid ** (k + 1) for k, c in enumerate(curve))
    top = int(np.argmax(sheet))

    def acting(u: Array) -> Array:
        size = (np.maximum(np.abs(u) - dead, 0.0) / (1 - dead)) ** exponent
        force = size * np.where(u < 0, reverse, 1.0) * 0.98 * sheet[top]
        return np.sign(u) * np.interp(force, sheet[: top + 1], grid[: top + 1])

    driver = setup.driver()
    with setup.plant.running():
        sensors = Sensors(scenario.noise, np.random.default_rng(setup.seeds.sensors))
        own = Curved(driver, acting)
        log = setup.plant.drive(
            own, setup.plant.begin(own, sensors), round(duration / scenario.dt), sensors
        )
    u = np.array([driver.command(t, log.q[0], log.v[0]) for t in log.t.tolist()])
    parts = {"q": log.q, "v": log.v, "u": u}
    header = ["t", *(f"{x}_{k}" for x, part in parts.items() for k in range(part.shape[1]))]
    path = folder / f"curve_{seed}.csv"
    table = np.column_stack([log.t, *parts.values()])[:: round(0.02 / scenario.dt)]
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.9g")
    truth = dict(zip(setup.system.space.labels, setup.plant.truth.tolist(), strict=True))
    truth |= {"dead zone": dead, "exponent": exponent, "reverse": reverse}
    return Drawn("curve", Path("bluerov2"), [path], None, truth)
