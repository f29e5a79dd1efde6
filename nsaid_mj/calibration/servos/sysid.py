"""MuJoCo's own toolbox, `mujoco.sysid`, on logs of a servo arm, with stock or with better options.

Both fit kp, kv, armature and frictionloss of every joint, from the values of a model file, by
open-loop simulations of whole logs with steps of 5 ms, in at most 15 iterations. The toolbox has no
prior; its search has bounds:

- stock: from a tenth of the start to ten times it, with the file's friction, the toolbox's own
  optimiser and normalised residuals;
- best: a factor of 1,100 about the start, in logarithms, with hard friction, residuals over 5 mrad,
  finite differences of 1 %, scaled variables, and a target 20 ms late, which it does not fit.
"""

import io
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from ...baselines.sysid import toolbox
from ...parameters import Array
from ...plants.world.coordinates import JointMap
from ...plants.world.quiet import quiet
from ...resources import write_text
from ...robot.mjcf_file import compile_file
from ...robot.tree import actuators_of, joint_names
from .export import HARD, hold_others
from .logs import ServoLogs

_STEP = 5e-3  # of a simulation [s]
_LEAST = np.array([[1e-3], [1e-3], [2e-3], [1.1e-2]])  # start of kp, kv, armature, frictionloss
_RANGE, _FACTOR = 10.0, 7.0  # of the searches: multiples of the start; ± in logarithms
_LATE = 0.02  # of the target, with the best options [s]
_UNIT = 5e-3  # of its residuals [rad or m]
_ITERATIONS = 15
_FAR = 1e3  # residual where a simulation diverges


def write_by_toolbox(given: ServoLogs, path: Path, best: bool) -> float:
    """Writes the MJCF that the toolbox finds for logs, from the values in the arm's own file.

    `given` are the arm and its logs, without loads; `best` chooses the better options. Returns the
    delay of the targets [s].

    Raises:
        NoEstimate: the toolbox is not installed.
    """
    search = _Search(given, best)
    search.model(search.fitted())
    write_text(path, search.spec.to_xml())
    return search.late


class _Search:
    """An arm as a function of (4, n) kp, kv, armature and frictionloss, and its logs."""

    def __init__(self, given: ServoLogs, best: bool):
        source, self.joints, self.best = given.robot.source, given.robot.joints, best
        assert source is not None  # a model with servos comes from a file
        self.spec, mj, _ = compile_file(source)
        for folder in ("meshdir", "texturedir"):
            setattr(self.spec, folder, str(source.resolve().parent / getattr(self.spec, folder)))
        self.spec.option.timestep = _STEP
        self.spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        names, dof = joint_names(mj), JointMap(mj, self.joints).dof
        self.servos = [actuators_of(mj, names.index(joint))[0] for joint in self.joints]
        kv = mj.dof_damping[dof] - mj.actuator_biasprm[self.servos, 2]
        start = given.kp, kv, mj.dof_armature[dof], mj.dof_frictionloss[dof]
        self.start, self.late = np.maximum(np.array(start), _LEAST), _LATE * best
        self.logs = []
        for log in given.logs:
            t = np.arange(log.t[0], log.t[-1], _STEP)
            held = np.maximum(np.searchsorted(log.t, t - self.late, side="right") - 1, 0)
            control = np.zeros((len(t), mj.nu))
            control[:, self.servos] = log.target[held]
            measured = np.column_stack([np.interp(t + _STEP, log.t, x) for x in log.position.T])
            self.logs.append((control, measured, log.position[0]))

    def model(self, values: Array) -> Any:
        """MuJoCo's model with given parameters, which are then those of the specification."""
        for name, i, own in zip(self.joints, self.servos, values.T, strict=True):
            kp, kv, armature, friction = (float(x) for x in own)
            joint, servo = self.spec.joint(name), self.spec.actuators[i]
            joint.armature, joint.frictionloss, joint.damping = armature, friction, [0, 0, 0]
            if self.best:
                joint.solimp_friction = [float(x) for x in HARD.split()]
            servo.gainprm[0], servo.biasprm[1], servo.biasprm[2] = kp, -kp, -kv
            servo.forcelimited = 0
        return self.spec.compile()

    def residual(self, values: Array) -> Array:
        """Simulated minus measured positions of all logs, over 5 mrad or the measured ones' rms."""
        mj, found = self.model(values), []
        where, kind = JointMap(mj, self.joints), mujoco.mjtState.mjSTATE_FULLPHYSICS
        at = [1 + mj.joint(joint).qposadr[0] for joint in self.joints]  # after the time
        state, still = np.zeros((1, mujoco.mj_stateSize(mj, kind))), np.zeros(len(at))
        for control, measured, first in self.logs:
            data = mujoco.MjData(mj)
            hold_others(mj, data, where)
            where.write(data, first, still)
            mujoco.mj_getState(mj, data, state[0], kind)
            out: Any = rollout.rollout(mj, data, state, control[None])[0]
            unit = _UNIT if self.best else np.maximum(measured.std(axis=0), 1e-6)
            found.append((out[0][:, at] - measured) / unit)
        return np.nan_to_num(np.concatenate(found).ravel(), nan=_FAR, posinf=_FAR, neginf=-_FAR)

    def fitted(self) -> Array:
        """(4, n) parameters at the end of the toolbox's search."""
        own, shape, start = toolbox(), self.start.shape, self.start
        low, high = start / _RANGE, start * _RANGE
        if self.best:
            start = np.log(start)
            low, high = start - _FACTOR, start + _FACTOR
        parameters = own.ParameterDict()
        parameters.add(own.Parameter("all", start.ravel(), low.ravel(), high.ravel()))

        def values(x: Array) -> Array:
            x = np.asarray(x).reshape(shape)
            return np.exp(x) if self.best else x

        def residual(x: Array, _: Any, **__: Any) -> Any:
            found = [self.residual(values(column)) for column in np.atleast_2d(x.T)]
            return [found[0] if x.ndim == 1 else np.column_stack(found)], [], []

        options = {"x_scale": "jac", "diff_step": 1e-2} if self.best else {}
        optimiser = "scipy_parallel_fd" if self.best else "mujoco"
        with quiet(), redirect_stdout(io.StringIO()):
            found = own.optimize(
                parameters, residual, optimiser, verbose=False, max_iters=_ITERATIONS, **options
            )[1]
        return values(found.x)
