"""A robot in MuJoCo that learns what its motors do while it moves.

    python examples/live/robot.py

This process is the robot and its controller. It sends every sample as a UDP datagram to another
process, `nsaid live --udp`, and divides its commands by the gains that come back. The true gains,
rotor inertias and frictions are known to MuJoCo alone.
"""

import json
import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import mujoco
import numpy as np

HERE = Path(__file__).parent
SECONDS = float(os.environ.get("NSAID_EXAMPLE_SECONDS", "30"))
PORT = int(os.environ.get("NSAID_EXAMPLE_PORT", "9870"))
RATE, SUBSTEPS = 200.0, 10
GAIN, ROTOR = np.array([0.7, 1.3]), np.array([0.02, 0.01])  # N·m per unit of command, kg·m²
VISCOUS, COULOMB = np.array([0.25, 0.12]), np.array([0.3, 0.08])  # N·m·s/rad, N·m


class Identifier:
    """`nsaid live` in another process, and the newest gains that it has printed."""

    def __init__(self, folder: Path):
        words = [
            sys.executable,
            "-P",
            "-c",
            "from nsaid_mj.cli import run_from_shell; run_from_shell()",
        ]
        words += [
            "live",
            "--model",
            str(HERE / "arm.urdf"),
            "--rate",
            str(RATE),
            "--udp",
            str(PORT),
        ]
        words += ["--out", str(folder), "--force", "--json", "--every", "0.02"]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        self.gains, self.misfit, self.verdict = np.ones(2), "", ""
        self._ready = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._ready.wait()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, sample: dict[str, object]) -> None:
        self._socket.sendto(json.dumps(sample).encode(), ("127.0.0.1", PORT))

    def end(self) -> None:
        self.send({"end": True})
        self._reader.join()
        self.process.wait()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            found = json.loads(line)
            if "gains" in found:
                values = np.array([gain[0] for gain in found["gains"]])
                self.gains, self.misfit = values / values.mean(), found["misfit"]
            self.verdict = found.get("summary", {}).get("verdict", self.verdict)
            self._ready.set()
        self._ready.set()


def reference(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions [rad] and velocities [rad/s] to be followed."""
    a, w = np.array([[0.5, 0.3], [0.6, 0.4]]), np.array([[2.1, 5.3], [3.2, 7.1]])
    return (a * np.sin(w * t)).sum(axis=1), (a * w * np.cos(w * t)).sum(axis=1)


def main() -> None:
    model = mujoco.MjModel.from_xml_path(str(HERE / "arm.urdf"))
    model.opt.timestep = 1 / (RATE * SUBSTEPS)
    model.dof_armature[:], model.dof_damping[:], model.dof_frictionloss[:] = ROTOR, 0.0, 0.0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    identifier = Identifier(Path("runs") / "example-live")
    begin = time.perf_counter()
    for k in range(round(SECONDS * RATE)):
        t = k / RATE
        time.sleep(max(0.0, begin + t - time.perf_counter()))
        q = data.qpos + 1e-4 * rng.standard_normal(2)
        v = data.qvel + 5e-3 * rng.standard_normal(2)
        target, speed = reference(t)
        torque = np.array([40.0, 20.0]) * (target - q) + np.array([2.0, 1.0]) * (speed - v)
        u = torque / identifier.gains
        identifier.send({"t": t, "q": q.tolist(), "v": v.tolist(), "u": u.tolist()})
        for _ in range(SUBSTEPS):
            friction = VISCOUS * data.qvel + COULOMB * np.tanh(data.qvel / 0.05)
            data.qfrc_applied[:] = GAIN * u - friction
            mujoco.mj_step(model, data)
        if k % round(RATE) == 0:
            print(f"{t:5.1f} s  gains over their mean {identifier.gains.round(3)}")
    identifier.end()
    print(f"gains over their mean: {identifier.gains.round(3)}, true: {GAIN / GAIN.mean()}")
    print(identifier.verdict)


if __name__ == "__main__":
    main()
