"""Intervals of servos' parameters on simulated hobby arms, with and without play in their gears.

    python -m scripts.servo_arms [--seeds 0:16] [--json FILE]

Each seed draws an SO-101 with servos of its own: kp, damping, friction, rotor, delay and speed of
motion at random, 2 to 10 logs of 150 s together, encoders of 4096 steps. Every fourth arm has no
play; the others have 2 to 9 mrad in all gears, at one place (`PLACES`). MuJoCo simulates it, the
identifier gets the file as it is published. Printed are the numbers whose 95 % intervals hold the
true value, by place and parameter, and all that do not. A kp, or an armature, that is a convention
because gravity does not tell it is left out.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.clinic.servos.result import UNTOLD
from tests.clinic.servos.simulated import JOINTS, MODEL, TICK, targets, write

Array = np.ndarray

PLACES = (
    "none",
    "within the loop",
    "beyond the motor's encoder",
    "between the servo's encoder and the log's",
)
"""Of play: the servo's encoder behind the gear; the servo's and the log's at the motor; the servo's
at the motor and the log's behind the gear."""
_STEP = 1e-3  # of the simulation [s]
_TOTAL = 150.0  # length of all logs together [s]
_HARD = [0.9999, 0.9999, 1e-3, 0.5, 2]  # solimp of friction that holds


class Drawn:
    """An arm with servos drawn from a seed.

    Attributes:
        place: one of `PLACES`.
        play: width of the play of each joint (6,) [rad].
        kp, T, f, armature: (6,) stiffness [N·m/rad], damping/kp [s], friction/kp [rad], rotor
            inertia [kg·m²].
        delay: of all targets [s].
        speed: of the fastest moves [rad/s].
        logs: their number.
    """

    def __init__(self, seed: int):
        rng = np.random.default_rng([seed, 77])
        self.seed = seed
        self.place = PLACES[seed % len(PLACES)]
        self.play = rng.uniform(2e-3, 9e-3, 6) * (self.place != PLACES[0])
        self.kp = rng.uniform(7, 25) * rng.uniform(0.8, 1.25, 6)
        self.T = rng.uniform(0.03, 0.08) * rng.uniform(0.8, 1.25, 6)
        self.f = rng.uniform(0.005, 0.035, 6)
        self.armature = rng.uniform(0.005, 0.03) * rng.uniform(0.7, 1.4, 6)
        self.delay = float(rng.uniform(0.005, 0.03))
        self.speed = float(rng.uniform(1.5, 4.0))
        self.logs = int(rng.integers(2, 11))

    def model(self) -> mujoco.MjModel:
        """MuJoCo's model; behind each joint a second one is the play of its gear."""
        spec = mujoco.MjSpec.from_file(str(MODEL))
        spec.option.timestep = _STEP
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        for j, servo in enumerate(spec.actuators):
            joint = spec.joint(servo.target)
            kp = self.kp[j]
            servo.gainprm[0], servo.biasprm[:3] = kp, [0, -kp, -kp * self.T[j]]
            servo.forcelimited = 0
            servo.ctrllimited = 0
            joint.damping[:], joint.armature = 0, self.armature[j]
            joint.frictionloss = kp * self.f[j]
            joint.solimp_friction[:], joint.solref_friction[:] = _HARD, [2 * _STEP, 1]
            if self.play[j] > 0:
                slack = joint.parent.add_joint(
                    name=f"slack_{j}", axis=joint.axis, pos=joint.pos, armature=1e-4
                )
                slack.damping[:], slack.frictionloss = 0.005, 0.002
                slack.limited, slack.range = 1, [-self.play[j] / 2, self.play[j] / 2]
                slack.solref_limit[:] = [2 * _STEP, 1]
        return spec.compile()

    def log(self, number: int) -> tuple[Array, Array, Array]:
        """(N,) times, (N, 6) targets and (N, 6) positions of a log."""
        rng = np.random.default_rng([self.seed, 78, number])
        mj = self.model()
        data = mujoco.MjData(mj)
        at = np.array([mj.joint(name).qposadr[0] for name in JOINTS])
        slack = at + 1 if self.play.any() else None
        samples = round(_TOTAL / self.logs / 0.02)
        t = 0.02 * np.arange(samples) + rng.uniform(-2e-3, 2e-3, samples)
        t -= t[0]
        u = targets(rng, t, self.speed)
        data.qpos[at] = u[0]
        ends = np.round(t / _STEP).astype(int)
        instants = np.arange(ends[-1]) * _STEP
        held = np.maximum(np.searchsorted(t, instants - self.delay + 1e-9, side="right") - 1, 0)
        q = np.repeat(u[:1], samples, axis=0)
        for k in range(1, samples):
            for i in range(ends[k - 1], ends[k]):
                data.ctrl[:] = u[held[i]]
                if slack is not None and self.place == PLACES[1]:
                    data.ctrl[:] -= data.qpos[slack]
                mujoco.mj_step(mj, data)
            q[k] = data.qpos[at]
            if slack is not None and self.place != PLACES[2]:
                q[k] += data.qpos[slack]
        return t, u, np.round(q / TICK) * TICK

    @property
    def truth(self) -> dict[str, float]:
        """The true numbers by the names of `nsaid identify`."""
        columns = {
            "T": self.T,
            "f": self.f,
            "kp": self.kp,
            "a": self.armature / self.kp,
            "d": np.full(6, self.delay),
            "armature": self.armature,
        }
        return {f"{name}_{j + 1}": float(x[j]) for name, x in columns.items() for j in range(6)}


def tried(seed: int) -> dict[str, Any]:
    """What is said of a drawn arm: each number with its place in units of half its interval."""
    drawn = Drawn(seed)
    with tempfile.TemporaryDirectory() as folder:
        files = [write(Path(folder, f"log_{k}.csv"), *drawn.log(k)) for k in range(drawn.logs)]
        given = servo_logs(MODEL, files)
    assert given is not None
    begin = time.process_time()
    found = identify_servos(given)
    off = {}
    firm = []
    for p in found.parameters:
        if UNTOLD in p.combination:
            continue
        true = drawn.truth[p.name]
        half = p.high - p.value if true > p.value else p.value - p.low
        off[p.name] = (true - p.value) / half if half > 0 else np.inf
        firm += [p.name] * (p.status == "identified")
    return {
        "seed": seed,
        "place": drawn.place,
        "off": off,
        "identified": firm,
        "explains": found.explains,
        "play": {f.where: f.data for f in found.findings if f.code == "play"},
        "seconds": time.process_time() - begin,
    }


def table(lines: list[dict[str, Any]]) -> str:
    """Shares of intervals that hold, by place of the play and by parameter."""
    names = ("T", "f", "kp", "a", "d", "armature")
    found = ["| play | arms | " + " | ".join(names) + " | all | identified |", "|---" * 10 + "|"]
    for place in (*PLACES, "all"):
        own = [line for line in lines if place in (line["place"], "all")]
        pairs = [
            (n, abs(x) <= 1, n in one["identified"]) for one in own for n, x in one["off"].items()
        ]
        sets = [[held for n, held, _ in pairs if n.startswith(f"{name}_")] for name in names]
        sets += [[held for _, held, _ in pairs], [held for _, held, firm in pairs if firm]]
        cells = [f"{sum(held)}/{len(held)}" for held in sets]
        found.append(f"| {place} | {len(own)} | {' | '.join(cells)} |")
    return "\n".join(found)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", default="0:16", help="such as 100:116")
    parser.add_argument("--json", type=Path, help="a line for each arm; a study goes on from it")
    chosen = parser.parse_args()
    known = {}
    if chosen.json is not None and chosen.json.is_file():
        every = [json.loads(text) for text in chosen.json.read_text("utf-8").splitlines()]
        known = {line["seed"]: line for line in every}
    lines = []
    for seed in range(*map(int, chosen.seeds.split(":"))):
        line = known.get(seed) or tried(seed)
        if seed not in known and chosen.json is not None:
            with chosen.json.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(line) + "\n")
        lines.append(line)
        out = {name: round(x, 2) for name, x in line["off"].items() if abs(x) > 1}
        seconds = f"{line['seconds']:.0f} s"
        told = line["play"].items()
        played = ", ".join(f"{j} {1e3 * own['width']:.1f} {own['place']}" for j, own in told)
        print(seed, line["place"], seconds, "outside:", out, "play:", played, flush=True)
    print(table(lines))


if __name__ == "__main__":
    main()
