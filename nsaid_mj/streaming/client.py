"""`live`: identifies a robot while a loop of the user's own moves it."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import Any

from numpy.typing import ArrayLike

from ..calibration.live_robot import LiveRobot
from ..calibration.measured import measured_scenario
from ..errors import BadRun, InvalidInput
from .estimate import Estimate, Names
from .samples import sample_of
from .session import Session

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

    The law runs in a process of its own, `nsaid live`, so that it never delays the user's loop.

    Args:
        model: path of a URDF, MJCF or vehicle's TOML file, or the name of a robot or vehicle.
        law: `efficient`, `memory`, `cone` or `paper`.
        rate: samples per second [Hz].
        frame: axes of a vehicle's pose and twist, `ENU/FLU` (z up) or `NED/FRD`.
        noise: standard deviations of positions [rad or m] and of velocities [rad/s or m/s].
        prior_error: largest relative error of the model file's values and of guessed frictions.
        gain: expected force per unit of command [N·m or N], for commands other than forces.
        lock: joints that do not move.
        joints: the joints that move, all others being locked; none for all.
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
    return LiveIdentifier(session, [*flags, *(["--view"] if view else [])])


class LiveIdentifier:
    """A live identification; see `live`.

    Attributes:
        estimate: the newest one; None before the law has taken in a sample.
        folder: of the run; None before it has begun.
        summary: the run's summary.json; empty before the context has ended.
    """

    def __init__(self, session: Session, flags: list[str]):
        self._system = session.robot.system
        self._space = Names.of(self._system.space)
        self._flags, self._lines = flags, queue.SimpleQueue[bytes | None]()
        self._ready, self._sent, self._arrived = threading.Event(), 0, threading.Condition()
        self._process: subprocess.Popen[bytes] | None = None
        self._threads: list[threading.Thread] = []
        self.estimate: Estimate | None = None
        self.folder: Path | None = None
        self.summary: dict[str, Any] = {}

    def __enter__(self) -> LiveIdentifier:
        """Starts the law's process, and waits until it is ready.

        Raises:
            BadRun: it has failed; its message is on the standard error.
        """
        words = [sys.executable, "-P", "-c", _START, "live", *self._flags, "--json", "--every", "0"]
        self._process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | _ONE_THREAD
        )
        self._threads = [threading.Thread(target=f, daemon=True) for f in (self._write, self._read)]
        for thread in self._threads:
            thread.start()
        self._ready.wait()
        self._check()
        return self

    @property
    def process(self) -> int:
        """Number of the law's process."""
        assert self._process is not None
        return self._process.pid

    def update(self, t: float, q: ArrayLike, v: ArrayLike, u: ArrayLike) -> Estimate | None:
        """Hands over a sample, and returns the newest estimate without waiting.

        It usually is that of the sample before; `estimate.t` says of which. A sample that is late,
        repeated or not finite is dropped and counted.

        Args:
            t: time [s].
            q: (m,) positions [rad or m]; of a vehicle position, quaternion (x, y, z, w), joints.
            v: (n,) velocities [rad/s or m/s]; of a vehicle along its own axes.
            u: (n_u,) commands, held from t until the next sample.

        Returns:
            The newest estimate; None before there is one.

        Raises:
            InvalidInput: a shape is wrong.
            BadRun: the law's process has failed; its message is on the standard error.
        """
        time, *parts = sample_of(self._system, t, q, v, u)
        named = zip("qvu", parts, strict=True)
        found = {"t": time} | {name: part.tolist() for name, part in named}
        self._lines.put(json.dumps(found).encode() + b"\n")
        self._sent += 1
        if self._process is None or self._process.returncode is not None:
            self._check()
        return self.estimate

    def wait(self, samples: int, timeout: float = 60.0) -> Estimate | None:
        """Waits until the law has taken in a number of samples; returns the newest estimate.

        Args:
            samples: that the law is to have used.
            timeout: longest wait [s].
        """
        with self._arrived:
            self._arrived.wait_for(
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
        self._lines.put(None)
        for thread in self._threads:
            thread.join()
        self._process.wait()
        if kind is None and not self.summary:
            self._check()

    def _check(self) -> None:
        if self._process is None:
            raise InvalidInput("identifier", "a context", "none", "Write `with nsaid_mj.live(…)`.")
        code = self._process.poll()
        if code is not None and not self.summary:
            where = self.folder or "nsaid live"
            raise BadRun(where, f"the process of the law has ended with code {code}", _REMEDY)

    def _write(self) -> None:
        assert self._process is not None and self._process.stdin is not None
        try:
            while (line := self._lines.get()) is not None:
                self._process.stdin.write(line)
                if self._lines.empty():
                    self._process.stdin.flush()
            self._process.stdin.close()
        except (BrokenPipeError, OSError):
            self._process.poll()

    def _read(self) -> None:
        assert self._process is not None and self._process.stdout is not None
        for line in self._process.stdout:
            found = json.loads(line)
            if "theta" in found:
                with self._arrived:
                    self.estimate = Estimate.of_line(found, self._space)
                    self._arrived.notify_all()
            elif "summary" in found:
                self.summary = found["summary"]
            else:
                self.folder = Path(found["folder"])
                self._ready.set()
        self._process.wait()
        self._ready.set()


_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
