"""`live`: identifies a robot while the user's own loop moves it."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import orjson
from numpy.typing import ArrayLike

from ..base import BadRun, InvalidInput
from .identify.measured import LiveRobot, measured_scenario
from .identify.models import load_robot_model
from .logs.stream import sample_of
from .session import LiveEstimate, Session
from .walking import SAMPLE, walking_sample

_START = "from nsaid_mj.cli.commands import run_from_shell; run_from_shell()"
_REMEDY = "See the message above; what was recorded is in the folder."


def live(
    model: str,
    law: str = "efficient",
    rate: float = 500.0,
    *,
    frame: str = "ENU/FLU",
    noise: tuple[float, float] = (1e-4, 5e-3),
    prior_error: float = 1.0,
    gain: float | None = None,
    lock: tuple[str, ...] = (),
    joints: tuple[str, ...] = (),
    out: str | Path | None = None,
    view: bool = False,
) -> LiveIdentifier:
    """Identifies a robot while it moves; use it as a context.

        with nsaid_mj.live("my_arm.urdf", law="efficient", rate=500) as identifier:
            for t, q, v, u in robot:
                estimate = identifier.update(t, q, v, u)

    The law runs in a separate process, `nsaid live`, so that it never delays the user's loop. Of a
    robot that stands and walks, pass the readings of its IMU to `update`: its samples are then
    identified together, as by `identify`, each time there are half as many more; `law`, `rate`,
    `noise`, `prior_error` and `gain` are then not used.

    Args:
        model: path of a URDF, MJCF or vehicle's TOML file, or the name of a robot or vehicle.
        law: `efficient`, `memory`, `cone` or `paper`.
        rate: samples per second [Hz].
        frame: axes of a vehicle's pose and twist, `ENU/FLU` (z up) or `NED/FRD`.
        noise: standard deviations of positions [rad or m] and of velocities [rad/s or m/s].
        prior_error: largest relative error of the model file's values and of guessed frictions.
        gain: expected force per unit of command [N·m or N], for commands other than forces.
        lock: joints that do not move.
        joints: the joints that move; all others are locked. If empty, all move.
        out: folder of the run; None for runs/NAME-live-LAW, numbered.
        view: stream into the Rerun viewer.

    Raises:
        BadRobot: the model file cannot be read.
        UnknownName: there is no such robot, joint or frame.
        InvalidInput: a value is wrong.
    """
    robot = LiveRobot(robot=str(model), lock=tuple(lock), joints=tuple(joints), gain=gain)
    scenario = measured_scenario(robot, law, rate, noise, prior_error)
    session = Session(scenario, frame)  # raises here what would end the process
    flags = ["--model", str(model), "--law", law, "--rate", repr(float(rate)), "--frame", frame]
    flags += ["--position-noise", repr(noise[0]), "--velocity-noise", repr(noise[1])]
    flags += ["--prior-error", repr(prior_error)]
    for flag, value in (("--lock", ",".join(lock)), ("--joints", ",".join(joints))):
        flags += [flag, value] if value else []
    flags += [] if gain is None else ["--gain", repr(gain)]
    flags += [] if out is None else ["--out", str(out)]
    flags += ["--view"] if view else []
    file = load_robot_model(str(model), tuple(lock), tuple(joints) or None)
    return LiveIdentifier(session, flags, len(file.joints) if file.walks else 0)


class LiveIdentifier:
    """A live identification; see `live`.

    Attributes:
        estimate: the newest one that `update` or `wait` has read; None before the first.
        folder: folder of the run; None before it has begun.
        summary: the run's summary.json; empty before the context has ended.
    """

    def __init__(self, session: Session, flags: list[str], legged: int = 0):
        """`legged` is the number of joints of a robot that may walk, 0 of others."""
        self._system = session.robot.system
        self._legged = legged
        self._with_imu: bool | None = None  # the samples; None before the first
        self._head: dict[str, Any] = {}
        self._flags, self._unsent, self._unread = flags, bytearray(), b""
        self._process: subprocess.Popen[bytes] | None = None
        self.estimate: LiveEstimate | None = None
        self.folder: Path | None = None
        self.summary: dict[str, Any] = {}

    def __enter__(self) -> LiveIdentifier:
        """Starts the law's process, and waits until it is ready.

        Whether a robot that may walk does is known from its first sample; it is not waited for.

        Raises:
            BadRun: it has failed; its message is on the standard error.
        """
        words = [sys.executable, "-P", "-c", _START, "live", *self._flags, "--json", "--every", "0"]
        process = self._process = subprocess.Popen(
            words,
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | _ONE_THREAD,
        )
        assert process.stdin is not None and process.stdout is not None
        self._given = process.stdin
        self._taken = process.stdout
        for pipe in (self._given, self._taken):
            os.set_blocking(pipe.fileno(), False)
        if not self._legged:
            self._exchange_until(lambda: self.folder is not None)
            if self.folder is None:
                self._check()
        return self

    @property
    def process(self) -> int:
        """ID of the law's process."""
        assert self._process is not None
        return self._process.pid

    def update(
        self, t: float, q: ArrayLike, v: ArrayLike, u: ArrayLike, imu: ArrayLike | None = None
    ) -> LiveEstimate | None:
        """Passes on a sample, and returns the newest estimate without waiting.

        It is usually that of the sample before; `estimate.t` is the time of its sample. A sample
        that is late, repeated or not finite is dropped and counted.

        Args:
            t: time [s].
            q: (m,) positions [rad or m]; for a vehicle position, quaternion (x, y, z, w), joints.
            v: (n,) velocities [rad/s or m/s]; for a vehicle along its own axes.
            u: (n_u,) commands, held from t until the next sample.
            imu: of a robot that stands and walks, (7,) or (10,) readings of its IMU: orientation
                (w, x, y, z), angular velocity [rad/s] and, if measured, specific force [m/s²]; q
                and v are then (k,) those of its joints. None if its base is held.

        Returns:
            The newest estimate; None before the first.

        Raises:
            InvalidInput: a shape is wrong, or only some of the samples have an `imu`.
            BadRun: the law's process has failed; its message is on the standard error.
        """
        found = self._checked(t, q, v, u, imu)
        self._unsent += orjson.dumps(found, option=_LINE)
        if self._process is None or self._process.returncode is not None or not self._exchange():
            self._check()
        return self.estimate

    def _checked(
        self, t: float, q: ArrayLike, v: ArrayLike, u: ArrayLike, imu: ArrayLike | None
    ) -> dict[str, Any]:
        """A sample as it is sent."""
        given = imu is not None
        if self._with_imu not in (None, given):
            expected = "all samples with it, or none"
            raise InvalidInput("imu", expected, "a sample of the other kind", _KINDS)
        if imu is None:
            at, *parts = sample_of(self._system, t, q, v, u)
            found = {"t": at} | dict(zip("qvu", parts, strict=True))
        elif self._legged:
            walking_sample(self._legged, t, q, v, u, imu)
            parts = (np.asarray(part, dtype=np.float64) for part in (q, v, u, imu))
            found = {"t": float(t)} | dict(zip(SAMPLE[1:], parts, strict=True))
        else:
            raise InvalidInput("imu", "a robot that stands and walks", "another robot", _KINDS)
        self._with_imu = given
        return found

    def wait(self, samples: int, timeout: float = 60.0) -> LiveEstimate | None:
        """Waits until the law has used so many samples, `timeout` [s] at most.

        Returns the newest estimate.
        """
        self._exchange_until(
            lambda: self.estimate is not None and self.estimate.samples >= samples, timeout
        )
        return self.estimate

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Ends the stream and waits for result and page.

        Raises:
            BadRun: the law's process has failed; its message is on the standard error.
        """
        assert self._process is not None
        self._exchange_until(lambda: not self._unsent)
        self._given.close()
        self._exchange_until(lambda: False)
        self._process.wait()
        self._taken.close()
        if kind is None and not self.summary:
            self._check()

    def _check(self) -> None:
        if self._process is None:
            raise InvalidInput("identifier", "a context", "none", "Write `with nsaid_mj.live(…)`.")
        code = self._process.wait()
        if not self.summary:
            where = self.folder or "nsaid live"
            raise BadRun(where, f"the process of the law has ended with code {code}", _REMEDY)

    def _exchange_until(self, done: Callable[[], bool], timeout: float = math.inf) -> None:
        """Exchanges with the law's process until it ends, time [s] is up, or `done`."""
        end = time.monotonic() + timeout
        while self._exchange() and not done() and time.monotonic() < end:
            time.sleep(_POLL)

    def _exchange(self) -> bool:
        """Writes what the pipe accepts, reads what has come; returns whether more can come.

        There is no thread, which would hold Python's lock while the user's loop needs it.
        """
        try:
            while self._unsent and not self._given.closed:
                del self._unsent[: os.write(self._given.fileno(), self._unsent[:_PIECE])]
        except BlockingIOError:
            pass
        except OSError:  # the process has ended; its output can still be read
            self._unsent.clear()
        try:
            while piece := os.read(self._taken.fileno(), _PIECE):
                self._unread += piece
        except BlockingIOError:
            piece = None
        *lines, self._unread = self._unread.split(b"\n")
        # the summary follows the last estimate
        for line in lines if self.folder is None else lines[-2:]:
            self._take(orjson.loads(line))
        return piece is None

    def _take(self, found: dict[str, Any]) -> None:
        """Processes a line from the law's process."""
        if "theta" in found:
            self.estimate = LiveEstimate.of_line(self._head | found)
        elif "summary" in found:
            self.summary = found["summary"]
        else:
            self._head = found
            self.folder = Path(found["folder"])


_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_KINDS = "An IMU's readings belong to every sample of a robot that stands and walks."
_LINE = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE
_PIECE = 65_536  # bytes written or read at once
_POLL = 1e-3  # pause between two exchanges, where the user waits [s]
