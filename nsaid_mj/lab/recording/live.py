"""Streams a run into the viewer while it runs: measurements and estimates, no true value."""

import socket
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import rerun as rr

from ...base import InvalidInput
from ...core import Log, Measurement, SecondOrderSystem, State
from ...report import Panel, Plots, Scene, live_recording
from ..evaluation.labels import EXCITATION_LEVELS, groups
from ..observer import Observer, RobotDescription
from ..scenario import Scenario
from .forces import ESTIMATED, Arrows, drawing_words, mounts_of
from .layout import pages_of_live_run
from .viewer import (
    GRPC_PORT,
    LOCAL,
    WEB_PORT,
    free_port,
    has_display,
    listening,
    program,
    serving,
)

_PERIOD = 0.05  # between two updates, in simulated time and in wall time [s]
_SHARE = 10  # poses are logged at intervals of at least ten times the time that logging takes
_PATIENCE = 5.0  # timeout for the viewer to start, and to receive the remaining data [s]


class LiveRecording(Observer):
    """Streams a run into a viewer window, or to a browser if there is no display.

    A failure of the viewer does not stop the run: it is reported in one line, and streaming ends.

    Args:
        name: name of the run.
        speed: simulated seconds per second of wall time, at most; 0 for no limit.

    Raises:
        InvalidInput: the speed is negative or not finite.
    """

    period = _PERIOD

    def __init__(self, name: str, speed: float = 1.0):
        if not 0 <= speed < np.inf:
            remedy = "1 is real time, 0 as fast as the run is computed."
            raise InvalidInput("live_speed", "a factor ≥ 0", speed, remedy)
        self._name = name
        self._speed = speed or np.inf
        self._begin: float | None = None  # wall time at which t = 0 is due [s]
        self._rec: rr.RecordingStream | None = None
        self._server: subprocess.Popen[bytes] | None = None
        self._next = self._next_pose = -np.inf
        self._arrows: Arrows | None = None

    def start(self, scenario: Scenario, robot: RobotDescription, first: Measurement) -> None:
        """Starts the viewer and shows the robot."""
        try:
            self._start(robot, first)
        except Exception as error:  # no error of the viewer may stop the run
            self._give_up(error)

    def see(self, log: Log, states: dict[str, State], levels: tuple[float, float]) -> None:
        """Streams Δv, θ̂ by block, excitation levels and the robot, at most 20 times a second."""
        if self._rec is None:
            return
        measurement = log.at(-1)
        self._wait(measurement.t)
        now = time.perf_counter()
        if now < self._next:
            return
        self._next = now + _PERIOD
        try:
            self._see(self._rec, measurement, states[""], levels)
        except Exception as error:
            self._give_up(error)

    def _wait(self, t: float) -> None:
        """Waits until simulated time t [s] is due; after a delay, the run does not catch up."""
        now = time.perf_counter()
        due = now if self._begin is None else self._begin + t / self._speed
        if due > now:
            time.sleep(due - now)
        else:
            self._begin = now - t / self._speed

    def stop(self) -> None:
        """Sends the remaining data. A window stays open; the web server is stopped."""
        rec = self._rec
        self._rec = None
        try:
            if rec is not None:
                rec.flush(timeout_sec=_PATIENCE)
                rec.disconnect()
        except Exception as error:
            self._give_up(error)
        finally:
            self._end_server()

    def _start(self, robot: RobotDescription, first: Measurement) -> None:
        system = robot.system
        self._space, self._scene = system.space, Scene(system, robot.looks)
        self._groups = groups(self._space)
        rng = np.random.default_rng(0)  # of random states, which set up camera and arrows
        states = [system.random_state(rng) for _ in range(50)]
        q, v, u = (np.array(part) for part in zip(*states, strict=True))
        rows = Log.unchecked(np.zeros(len(q)), q, v, u)
        camera = None
        if not self._scene.empty:
            camera = self._scene.camera(np.vstack([first.q, q[:20]]), v)
        if camera and mounts_of(system):
            self._arrows = Arrows(system, camera.size, rows, self._space.scale)
        magnified = self._arrows.magnified if self._arrows else None
        drawn = drawing_words("Estimated (orange): forces" if self._arrows else "", magnified)
        pages = pages_of_live_run(self._space, camera, drawn)
        address = self._open() if has_display() else self._serve()
        rec = live_recording(address, f"{self._name} live", pages)
        self._scene.log_shapes(rec, camera, ghost=self._arrows is not None)
        if self._arrows:
            self._arrows.log_style(rec, ESTIMATED)
        for lines in Plots.of(_streamed(system), None).curves:
            lines.log_style(rec)
        self._rec = rec

    def _open(self) -> str:
        """Opens a window, which outlives the run; returns the address to send data to."""
        port = free_port(GRPC_PORT)
        flags = [*listening(port), "--hide-welcome-screen", "--expect-data-soon"]
        viewer = _launch(flags, start_new_session=True)
        _wait_for(viewer, port)
        return _target(port)

    def _serve(self) -> str:
        """Starts a web server on the loopback interface; returns the address to send data to.

        `RecordingStream.serve_grpc` and `serve_web_viewer` do this within the process, but listen
        on all network interfaces.
        """
        port = free_port(GRPC_PORT)
        web = free_port(WEB_PORT)
        self._server = _launch(serving(port, web))
        _wait_for(self._server, port)
        _wait_for(self._server, web)
        page = f"http://{LOCAL}:{web}?url={_target(port).replace('+', '%2B')}"
        print(f"nsaid: no display here; watch the run at {page}", file=sys.stderr)
        return _target(port)

    def _see(
        self,
        rec: rr.RecordingStream,
        measurement: Measurement,
        state: State,
        levels: tuple[float, float],
    ) -> None:
        rec.set_time("sim_time", duration=measurement.t)
        rec.log("velocity_error", rr.Scalars(state.v_hat - measurement.v))
        for group in self._groups:
            rec.log(
                Plots.entity(*group.key, "estimated"), rr.Scalars(state.theta_hat[group.indices])
            )
        rec.log("excitation/all", rr.Scalars(levels[0]))
        rec.log("excitation/perpendicular", rr.Scalars(levels[1]))
        begin = time.perf_counter()
        if begin >= self._next_pose:
            row = Log.unchecked_of([measurement])
            self._scene.log_poses(rec, row.t, row.q)
            if self._arrows:
                self._arrows.log(rec, ESTIMATED, row, state.theta_hat)
            self._next_pose = begin + _SHARE * (time.perf_counter() - begin)

    def _give_up(self, error: Exception) -> None:
        self._rec = None
        self._end_server()
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        print(f"nsaid: continuing without the viewer: {reason}", file=sys.stderr)

    def _end_server(self) -> None:
        server = self._server
        self._server = None
        if server is not None:
            server.terminate()
            try:
                server.wait(timeout=_PATIENCE)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()


def _launch(flags: list[str], start_new_session: bool = False) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [*program(), *flags],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=start_new_session,
    )


def _wait_for(viewer: subprocess.Popen[bytes], port: int) -> None:
    """Waits until the viewer accepts connections.

    Raises:
        ConnectionError: the viewer exited.
        TimeoutError: the viewer did not answer.
    """
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        if viewer.poll() is not None:
            raise ConnectionError(f"the Rerun viewer exited with code {viewer.returncode}")
        try:
            socket.create_connection((LOCAL, port), timeout=0.2).close()
            return
        except OSError:
            time.sleep(0.05)
    raise TimeoutError(f"the Rerun viewer did not answer within {_PATIENCE:g} s")


def _target(port: int) -> str:
    return f"rerun+http://{LOCAL}:{port}/proxy"


def _streamed(system: SecondOrderSystem) -> list[Panel]:
    """What is streamed, without values: panels as `curves` makes them of a finished run."""
    none = np.zeros(0)
    error = Panel("", "", key=("velocity_error",))
    names = [f"Δ{name}" for name in system.velocity_names]
    error.add_columns(none, np.zeros((0, len(names))), names)
    panels = [error]
    for group in groups(system.space):
        panel = Panel("", "", key=group.key)
        width = len(group.names)
        panel.add_columns(none, np.zeros((0, width)), group.names, ("estimated",))
        panels.append(panel)
    excitation = Panel("", "", key=("excitation",))
    for part, name in zip(("all", "perpendicular"), EXCITATION_LEVELS, strict=True):
        excitation.add(none, none, name, part=(part,))
    excitation.curves = [replace(curve, steps=True) for curve in excitation.curves]
    return [*panels, excitation]
