"""The peer, `mujoco.sysid`, on logs of a servo arm: with stock options and with its best ones.

    python scripts/peer.py FOLDER   # with so101.xml and logs NAME.csv.gz

Both fit kp, kv, armature and frictionloss of every joint, on every other log, by open-loop
simulations with steps of 5 ms; the others judge. Stock: the file's friction, the toolbox's own
optimiser and normalised residual. Best: hard friction, logarithms, residuals over 5 mrad, steps of
.01, scaled variables, no optimum sought beyond 15 steps, and a target 20 ms late, which the toolbox
does not fit. Each from the kp of the file and from 48.
"""

from __future__ import annotations

import argparse
import io
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import mujoco.sysid as toolbox
import numpy as np
from mujoco import rollout as simulation

from nsaid_mj.calibration.servos import ServoLogs, rollout, servo_logs
from nsaid_mj.parameters import Array
from nsaid_mj.plants.world.quiet import quiet

STEP = 5e-3  # of a simulation [s]
KINDS = {"kp": 0.0, "kv": 0.0, "armature": 1e-3, "friction": 1e-2}  # and their least values
HARD = [0.9999, 0.9999, 0.001, 0.5, 2.0]
RANGE = 10.0  # of the stock search, in multiples of the start
LATE = 0.02  # of the target, in the best options [s]


class Options(NamedTuple):
    """How the toolbox is used."""

    name: str
    best: bool
    kp: float | None


class Fit:
    """The arm's model as a function of (4, n) parameters, and its residual on logs."""

    def __init__(self, given: ServoLogs, path: Path, options: Options):
        self.joints, self.best, self.path = given.robot.joints, options.best, path
        self.spec = mujoco.MjSpec.from_file(str(path))
        mj = self.spec.compile()
        self.spec.option.timestep = STEP
        self.spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        dof = [mj.joint(name).dofadr[0] for name in self.joints]
        kp = given.kp if options.kp is None else np.full(len(dof), options.kp)
        start = kp, -mj.actuator_biasprm[:, 2], mj.dof_armature[dof], mj.dof_frictionloss[dof]
        self.start = np.maximum(np.array(start), np.array(list(KINDS.values()))[:, None] + 1e-3)
        self.logs = []
        for log in given.logs:
            t = np.arange(log.t[0], log.t[-1], STEP)
            held = np.searchsorted(log.t, t - LATE * self.best, side="right") - 1
            measured = np.column_stack([np.interp(t + STEP, log.t, x) for x in log.position.T])
            self.logs.append((log.target[np.maximum(held, 0)], measured, log.position[0]))

    def model(self, values: Array) -> Any:
        """MuJoCo's model with given (4, n) parameters."""
        for i, (name, kp, kv, armature, friction) in enumerate(
            zip(self.joints, *values, strict=True)
        ):
            joint, actuator = self.spec.joint(name), self.spec.actuators[i]
            joint.armature, joint.frictionloss, joint.damping = armature, friction, [0, 0, 0]
            if self.best:
                joint.solimp_friction = HARD
            actuator.gainprm[0], actuator.biasprm[1], actuator.biasprm[2] = kp, -kp, -kv
            actuator.forcelimited = 0
        return self.spec.compile()

    def residual(self, values: Array) -> Array:
        """Simulated minus measured positions of all logs [5 mrad], or as scaled by the toolbox."""
        mj, found = self.model(values), []
        for target, measured, first in self.logs:
            data = mujoco.MjData(mj)
            data.qpos[:] = first
            kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
            state = np.zeros((1, mujoco.mj_stateSize(mj, kind)))
            mujoco.mj_getState(mj, data, state[0], kind)
            out: Any = simulation.rollout(mj, data, state, target[None])[0]
            error = out[0][:, 1 : 1 + len(self.joints)] - measured
            found.append(error / (5e-3 if self.best else measured.std(axis=0)))
        return np.nan_to_num(np.concatenate(found).ravel(), nan=1e3, posinf=1e3, neginf=-1e3)

    def __call__(self) -> Array:
        """(4, n) parameters at the end of the toolbox's search."""
        shape, log = self.start.shape, self.best
        start = np.log(self.start) if log else self.start
        low, high = (start - 7, start + 7) if log else (start / RANGE, start * RANGE)
        parameters = toolbox.ParameterDict()
        parameters.add(toolbox.Parameter("all", start.ravel(), low.ravel(), high.ravel()))

        def residual(x: Array, _: Any, **__: Any) -> Any:
            columns = [x] if x.ndim == 1 else list(x.T)
            values = [np.exp(c) if log else c for c in columns]
            found = np.column_stack([self.residual(v.reshape(shape)) for v in values])
            return [found[:, 0] if x.ndim == 1 else found], [], []

        best = {"x_scale": "jac", "diff_step": 1e-2, "max_iters": 15}
        options: dict[str, Any] = best if self.best else {"max_iters": 15}
        optimiser = "scipy_parallel_fd" if self.best else "mujoco"
        with quiet(), redirect_stdout(io.StringIO()):
            found = toolbox.optimize(parameters, residual, optimiser, verbose=False, **options)[1]
        x = np.asarray(found.x).reshape(shape)
        return np.exp(x) if log else x


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--options", default="stock best", help="which ones")
    folder, chosen = vars(parser.parse_args()).values()
    given = servo_logs(folder / "so101.xml", sorted(folder.glob("*.csv.gz")))
    assert given is not None
    print("| options | from kp | mean absolute error [mrad] | kp of the joints | CPU s |")
    print("|---|---|---|---|---|")
    for options in (
        Options("stock", False, None),
        Options("stock", False, 48.0),
        Options("best", True, None),
        Options("best", True, 48.0),
    ):
        if options.name not in chosen:
            continue
        errors, begin = [], time.process_time()
        fit = Fit(given._replace(logs=given.logs[::2]), folder / "so101.xml", options)
        values = fit()
        seconds = time.process_time() - begin
        with tempfile.TemporaryDirectory() as made:
            path = Path(made, "sysid.xml")
            fit.model(values)
            path.write_text(fit.spec.to_xml())
            for log in given.logs[1::2]:
                found = rollout(path, given.robot.joints, log, LATE * options.best)
                errors.append(1e3 * np.abs(found - log.position).mean())
        kp = " ".join(f"{x:.3g}" for x in values[0])
        start = "the file's" if options.kp is None else f"{options.kp:g}"
        print(
            f"| {options.name} | {start} | {np.mean(errors):.1f} | {kp} | {seconds:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
