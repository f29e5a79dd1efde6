"""MuJoCo's own identification toolbox, `mujoco.sysid`, on an arm's log.

It simulates every chunk of the log from its measured initial state and fits the motion by nonlinear
least squares. The model is built from the structure and the prior; no plant is read.
"""

from __future__ import annotations

import io
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from functools import cache
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numba import carray, cfunc, types
from scipy import signal

from ...base import NoEstimate, pin
from ...core import Array, JointTree
from ...robots import quiet, tree_spec
from .world.callbacks import ARRAYS, WORDS, field_offsets, installed
from .world.coordinates import JointMap

if TYPE_CHECKING:
    from ...core import Log, SecondOrderSystem, SensorLevels

_CHUNK = 0.5  # length of a simulated stretch [s]
_SMOOTHING = 0.16  # width of the cubic fit for the initial states of noisy logs [s]
_RANGE = (0.1, 10.0)  # search range of the joints' parameters, in multiples of the prior
_THREADS = 2
_FRICTION = "coulomb friction"  # name of MuJoCo's custom numeric field
_MODEL_WORDS = 1 << 10  # how many 8-byte words of mjModel are searched; its pointers come early


class Toolbox:
    """`mujoco.sysid`, MuJoCo's own toolbox.

    Attributes:
        module: the module.
        BUDGET: default limit of the CPU time of a search [s].

    Raises:
        NoEstimate: it lacks its own dependencies.
    """

    BUDGET = 120.0

    def __init__(self) -> None:
        import mujoco.sysid

        if not hasattr(mujoco.sysid, "optimize"):  # MuJoCo suppresses the ImportError
            remedy = "pip install 'mujoco[sysid]'"
            raise NoEstimate("mujoco.sysid lacks its own dependencies", remedy)
        self.module: Any = mujoco.sysid

    def fitted(
        self,
        system: SecondOrderSystem,
        logs: Sequence[Log],
        prior: Array,
        noise: SensorLevels,
        budget: float = BUDGET,
    ) -> tuple[Array, str]:
        """`mujoco.sysid` with a parallel finite-difference Jacobian, all parameters free.

        Chunks of 0.5 s start at the measured state or, if noise is stated, at that of a cubic
        fitted to the samples within ±80 ms. Residuals are those of positions and velocities,
        normalised per chunk by the toolbox. Links are parameterised as log-Cholesky
        pseudo-inertias; other parameters are searched between 0.1 and 10 times the prior.

        Args:
            system: an arm.
            logs: of this arm, at one rate.
            prior: (p,) θ̂(0), which must be physical.
            noise: standard deviations of the sensors.
            budget: CPU time of the search, which then returns its best candidate [s].

        Returns:
            (p,) θ̂, and how the search ended, in words.

        Raises:
            NoEstimate: the system is not an arm, MuJoCo rejects the prior, or all logs are shorter
                than a chunk.
        """
        if not isinstance(system, JointTree) or system.group or system.n_u < system.n:
            reason = "mujoco.sysid is set up for fixed-base arms with a motor on every joint only"
            raise NoEstimate(reason, "Leave it out.")
        model = _SysidModel(self.module, system, prior, logs[0].step)
        chunks = [c for each in logs for c in model.chunks(each, noise.exact)]
        if not chunks:
            raise NoEstimate(f"the log is shorter than a chunk of {_CHUNK:g} s", "Record longer.")
        search = _TimedSearch(self.module, model, chunks, time.process_time() + budget)
        with quiet(), installed(_friction().ctypes):
            ending = search()
        evaluations = f"{search.evaluations} models, {len(chunks)} chunks"
        return model.theta(search.best), f"{ending}, {evaluations}"


class _OutOfTime(Exception):
    """Ends a search at its time limit; not an error."""


class _TimedSearch:
    """The toolbox's optimiser with a time limit; keeps the best candidate."""

    def __init__(self, toolbox: Any, model: _SysidModel, chunks: list[Any], deadline: float):
        self._toolbox = toolbox
        self._model = model
        self._chunks = chunks
        self._deadline = deadline
        self._cost = np.inf
        self.best = model.parameters.as_vector()
        self.evaluations = 0

    def __call__(self) -> str:
        """Runs the search and returns how it ended, in words."""
        try:
            with redirect_stdout(io.StringIO()):  # its optimiser prints every iteration
                _, result = self._toolbox.optimize(
                    self._model.parameters,
                    self._residual,
                    "scipy_parallel_fd",
                    verbose=False,
                    x_scale="jac",
                )
        except _OutOfTime:
            return "stopped at the time limit"
        self.best = result.x
        return "converged" if result.status > 0 else "ended at the toolbox's iteration limit"

    def _residual(self, x: Array, parameters: Any, **_: Any) -> Any:
        """Residuals of all chunks for one candidate x (p,), or for each column of x (p, k)."""
        if time.process_time() > self._deadline:
            raise _OutOfTime
        found, predicted, measured = self._toolbox.model_residual(
            x, parameters, self._model.build, self._chunks, n_threads=_THREADS, resample_true=False
        )
        if x.ndim == 1:
            self.evaluations += 1
            cost = float(found @ found)
            if cost < self._cost:
                self._cost, self.best = cost, x.copy()
        else:  # one column per candidate and chunk: stack the chunks of a candidate
            candidates = x.shape[1]
            chunks = len(self._chunks)
            self.evaluations += candidates
            found = found.reshape(-1, candidates, chunks).transpose(2, 0, 1)
            found = found.reshape(-1, candidates)
        return [found], predicted, measured


class _SysidModel:
    """MuJoCo's model of an arm as a function of the parameters, built from structure and prior."""

    def __init__(self, toolbox: Any, system: JointTree, prior: Array, step: float):
        self._toolbox = toolbox
        self._system = system
        tree = pin.Model(system.model)
        for i in range(system.bodies):
            inertia = pin.Inertia.FromDynamicParameters(prior[10 * i : 10 * i + 10])
            tree.inertias[i + 1] = inertia
        self._spec, self._names = tree_spec(tree, step), list(tree.names)[1:]
        numbers = prior[10 * system.bodies :].reshape(-1, system.n)
        self._kinds = ("rotor", "viscous", "coulomb", "gain")[-len(numbers) :]
        joints = dict(zip(self._kinds, numbers, strict=True))
        self._spec.add_numeric(name=_FRICTION, size=1 + 2 * system.n)
        for name in self._names:
            self._spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        for kind, value in joints.items():
            self._set(kind, value)
        try:
            self.compiled = self._spec.compile()
        except ValueError as error:
            raise NoEstimate(
                f"MuJoCo rejects the prior: {error}", "Use a physically consistent prior."
            ) from error
        self.joints = JointMap(self.compiled, self._names)
        if not np.array_equal(self.joints.dof, np.arange(system.n)):
            raise NoEstimate("MuJoCo orders the joints differently", "Leave sysid out.")

        def give_inertia(spec: Any, parameter: Any) -> None:
            self._give_inertia(
                spec, parameter
            )  # the toolbox deep-copies modifiers, and self with a bound method

        self.parameters = toolbox.ParameterDict()
        for name in self._names:
            self.parameters.add(
                toolbox.body_inertia_param(
                    self._spec,
                    self.compiled,
                    name,
                    toolbox.InertiaType.Pseudo,
                    modifier=give_inertia,
                )
            )
        for kind, value in joints.items():
            low, high = (factor * value for factor in _RANGE)
            self.parameters.add(
                toolbox.Parameter(
                    kind, value, low, high, modifier=lambda _, p: self._set(p.name, p.value)
                )
            )

    def _give_inertia(self, spec: Any, parameter: Any) -> None:
        """Writes a link's inertia into the specification."""
        name = parameter.name.removesuffix("_inertia")
        self._toolbox.model_modifier.apply_body_theta_inertia(spec, name, parameter.value)
        spec.body(name).iquat = [1.0, 0.0, 0.0, 0.0]  # the toolbox leaves NaN there

    def _set(self, kind: str, values: Array) -> None:
        """Writes one kind of parameter of all joints into the specification."""
        if kind == "coulomb":
            numbers = [[float(len(values))], values, 1 / self._system.friction_speed]
            self._spec.numeric(_FRICTION).data = np.concatenate(numbers)
            return
        for name, value in zip(self._names, values, strict=True):
            if kind == "gain":
                self._spec.actuator(name).gainprm[0] = value
            elif kind == "viscous":
                self._spec.joint(name).damping = [value, 0, 0]
            else:
                self._spec.joint(name).armature = value

    def build(self, parameters: Any) -> Any:
        """MuJoCo's model of a candidate."""
        return self._toolbox.apply_param_modifiers(parameters, self._spec)

    def chunks(self, log: Log, exact: bool) -> list[Any]:
        """A log in chunks, each with its initial state, which is measured if that is exact."""
        toolbox = self._toolbox
        samples = round(_CHUNK / log.step)
        if len(log.t) <= samples:
            return []
        angles = self._angles(log.q)
        q = angles
        v = log.v
        if not exact:
            width = 2 * round(0.5 * _SMOOTHING / log.step) + 1
            q, v = (signal.savgol_filter(x, max(width, 5), 3, axis=0) for x in (q, v))
        qpos, qvel, _, control = toolbox.TimeSeries.compute_all_state_mappings(self.compiled)
        found = []
        for k in range(0, len(log.t) - samples, samples):
            part = slice(k, k + samples + 1)
            times = log.t[part] - log.t[k]
            found.append(
                toolbox.SystemTrajectory(
                    model=self.compiled,
                    control=toolbox.TimeSeries(times, log.u[part], control),
                    sensordata=toolbox.TimeSeries(
                        times, np.hstack([angles[part], log.v[part]]), qpos | qvel
                    ),
                    initial_state=toolbox.create_initial_state(self.compiled, q[k], v[k]),
                    state=None,
                )
            )
        return found

    def _angles(self, q: Array) -> Array:
        """(N, n) joint angles and displacements of positions (N, m), unwrapped in time."""
        first = np.empty(self._system.n)
        for joint in self._system.joints:
            at = joint.idx_q
            first[joint.idx_v] = q[0, at] if joint.nq == 1 else np.arctan2(q[0, at + 1], q[0, at])
        return np.cumsum(np.vstack([first, self._system.moves(q)]), axis=0)

    def theta(self, x: Array) -> Array:
        """(p,) θ of a candidate."""
        self.parameters.update_from_vector(x)
        model = self.build(self.parameters)
        links = []
        for name in self._names:
            body = model.body(name)
            w, i, j, k = body.iquat
            axes = pin.Quaternion(w, i, j, k).toRotationMatrix()
            about = axes @ np.diag(body.inertia) @ axes.T
            links.append(pin.Inertia(body.mass[0], body.ipos, about).toDynamicParameters())
        return np.concatenate([*links, *(self.parameters[kind].value for kind in self._kinds)])


@cache
def _numeric_offset() -> int:
    """Offset in mjModel, in 8-byte words, of the pointer to its custom numeric data.

    Raises:
        RuntimeError: the layout of mjModel is not the expected one.
    """
    import ctypes

    spec = mujoco.MjSpec()
    spec.add_numeric(name="probe", size=1, data=[1.0])
    model: Any = spec.compile()
    words = (ctypes.c_uint64 * _MODEL_WORDS).from_address(model._address)
    address = model.numeric_data.ctypes.data
    found = next((i for i in range(_MODEL_WORDS) if words[i] == address), None)
    if found is None:
        raise RuntimeError(
            "mjModel.numeric_data not found: this MuJoCo lays out mjModel differently"
        )
    return found


@cache
def _friction() -> Any:
    """Callback for the passive force −c_i tanh(q̇_i/s_i), with parameters from mjModel.

    Every candidate is a model of its own; its custom numeric data are [nv, c (nv), 1/s (nv)].
    """
    at_numbers = _numeric_offset()
    offsets = field_offsets()
    at_qvel = offsets["qvel"]
    at_force = offsets["qfrc_passive"]

    @cfunc(types.void(ARRAYS, ARRAYS))
    def passive(model, data):
        own: Any = carray(model, (_MODEL_WORDS,))
        arrays: Any = carray(data, (WORDS,))
        nv = int(carray(own[at_numbers], (1,))[0])
        numbers = carray(own[at_numbers], (1 + 2 * nv,))
        velocity = carray(arrays[at_qvel], (nv,))
        force = carray(arrays[at_force], (nv,))
        for i in range(nv):
            force[i] -= numbers[1 + i] * np.tanh(velocity[i] * numbers[1 + nv + i])

    return passive
