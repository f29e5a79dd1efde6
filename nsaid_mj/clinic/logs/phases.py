"""The phases of a log: stretches in which one structure can hold, and those in which it cannot.

A vehicle on the ground, in somebody's hands or after a crash is held by forces that no structure
contains, and a fit to such rows spoils all parameters. The log's own events (armed, landed, motors
stopped, crashed) come first; then its signals, in parts of a tenth of a second: what moves, what
the motors would exert under the model's published values, and whether that balances.

A controller's mode decides which commands it gives, not what these do, so no part is left out for
its mode; modes are shown with the phases.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy import ndimage

from ...base import Finding
from ...core import Array, Log, number
from ...robots import RobotModel
from . import signals
from .mapping import Phases
from .tables import Channel

Kind = Literal[
    "airborne",
    "moving",
    "disarmed",
    "landed",
    "at rest",
    "held",
    "carried",
    "after an impact",
    "left out",
    "moved by hand",
    "paused controller",
    "contact",
]
USED = ("airborne", "moving")

_PART = 0.1  # length of the parts of a log [s]
_WINDOW = 5  # parts over which rest, constancy and balance are judged
_STILL = 0.02  # speed over the log's fast ones, below which nothing moves
_NOISE = 2.5  # the same over the noise of a part's mean
_DRIFTS = 4.0  # speed over that, at which a rest goes on while the motors are off
_OFF = 0.1  # force of the motors over the log's large ones, below which they are off
_CONSTANT = 0.02  # its change over the same, below which commands rest
_UNBALANCED = 0.3  # missing force over the same, or the weight, from which something holds it
_PUSHES = 0.2  # change of the force, over the same, that would move what nothing holds
_SUPPORT = 0.5  # weight over the usual force, from which motors carry it; part that is missing
_TOUCHES = 5  # parts before such a phase that are left out, too: its touch-down
_LEAVES = 1  # parts after it: lifting off
_MOMENT = 3  # parts of a phase that has no name of its own beside others
_BEFORE = 30  # parts before a phase in which an impact may have begun it
_IMPACT = 3.0  # change of the velocity over the largest usual one
_FAST = 0.98  # quantiles of what is large
_LARGEST = 0.995


class Event(NamedTuple):
    """A span of time in which a log says that a vehicle is disarmed or landed, or in which mode."""

    kind: Kind | Literal["mode"]
    start: float  # [s]
    end: float  # [s]
    column: str  # which says so
    name: str = ""  # of a mode


class LogPhase(NamedTuple):
    """A stretch of a log in which one structure can hold, or cannot."""

    kind: Kind
    source: str  # name of the file
    log: Log  # the motion in it, in the robot's coordinates
    why: str = ""  # why it takes no part in the fit; "" if it does
    modes: tuple[Event, ...] = ()  # of the controller, in the whole log

    @property
    def used(self) -> bool:
        """Whether it takes part in the fit."""
        return self.kind in USED

    @property
    def seconds(self) -> float:
        """Its duration [s]."""
        return float(self.log.t[-1] - self.log.t[0])

    @property
    def row(self) -> tuple[str, str, str, str]:
        """Its line of a table: file, time span, kind, why it is not used."""
        span = f"{self.log.t[0]:.1f} – {self.log.t[-1]:.1f} s"
        said = "used" if self.used else f"left out: {self.why}"
        names = ", ".join(dict.fromkeys(mode.name for mode in self.own_modes))
        return self.source, span, self.kind, f"{said} (mode {names})" if names else said

    @property
    def own_modes(self) -> list[Event]:
        """The modes during the phase, each from its start at the earliest to its end."""
        first, last = self.log.t[[0, -1]].tolist()
        spans = [
            mode._replace(start=max(mode.start, first), end=min(mode.end, last))
            for mode in self.modes
        ]
        return [mode for mode in spans if mode.end > mode.start]


_SAID: tuple[tuple[Kind, str, frozenset[float], bool], ...] = (
    ("disarmed", "vehicle_status/arming_state", frozenset({2.0}), False),
    ("disarmed", "actuator_armed/armed", frozenset({0.0}), True),
    *(  # the outputs are then not those that the log's commands state
        ("disarmed", f"actuator_armed/{name}", frozenset({0.0}), False)
        for name in ("lockdown", "manual_lockdown", "kill", "force_failsafe", "termination")
    ),
    *(
        ("landed", f"vehicle_land_detected/{name}", frozenset({0.0}), False)
        for name in ("landed", "maybe_landed", "ground_contact")
    ),
)
"""Kind, column, values, and whether these say so or all others do.

Sources: https://docs.px4.io/main/en/msg_docs/ and
https://ardupilot.org/copter/docs/logmessages.html.
"""

_ARMED = ("armed", "is_armed", "torque_enable", "torque_enabled", "motors_on", "motor_enabled")
"""Columns that are 0 while the motors are off, by the last word of their names."""

_CHANGES: tuple[tuple[Kind, str, tuple[int, ...], tuple[int, ...]], ...] = (
    ("disarmed", "ARM/ArmState", (0,), (1,)),
    ("disarmed", "EV/Id", (11,), (10,)),
    ("disarmed", "EV/Id", (54,), (55,)),  # emergency stop of the motors
    ("disarmed", "EV/Id", (56,), (57,)),  # interlock of the motors
    ("landed", "EV/Id", (17, 18), (28,)),  # 17: perhaps
)
"""Kind, column of ArduPilot's changes, and the values that begin and end it.

Until the first change the opposite held: an ROV logs from arming on, and its first is to disarm.
"""

_CRASH = 12.0  # subsystem of ArduPilot's errors (`ERR`) that finds a crash; 0 of its code clears it

_MODE = ("mode", "flight_mode", "flightmode", "nav_state", "modenum")
"""Columns of a controller's mode, by the last word of their names."""

_MOST_MODES = 64  # numbers of a column of modes, at most

_COPTER = (
    "Stabilize, Acro, AltHold, Auto, Guided, Loiter, RTL, Circle, , Land, , Drift, , Sport, Flip, "
    "AutoTune, PosHold, Brake, Throw, Avoid ADSB, Guided NoGPS, SmartRTL, FlowHold, Follow, "
    "ZigZag, SystemID, Autorotate, Auto RTL, Turtle"
)
_SUB = (
    "Stabilize, Acro, AltHold, Auto, Guided, , , Circle, , Surface, , , , , , , PosHold, , , "
    "Manual, Motor Detect, SurfTrak"
)
_PX4 = (
    "Manual, Altitude, Position, Mission, Loiter, RTL, Position Slow, , , , Acro, , Descend, "
    "Termination, Offboard, Stabilized, , Takeoff, Land, Follow, Precision Land, Orbit, "
    "VTOL Takeoff"
)
_OF_PX4 = "vehicle_status/nav_state"
_OF_ARDUPILOT = {"rotor": _COPTER, "thruster": _SUB}
"""Names of modes in the order of their numbers, of ArduPilot's by the vehicle's kind of actuator.

Sources: https://mavlink.io/en/messages/ardupilotmega.html (COPTER_MODE, SUB_MODE) and
https://docs.px4.io/main/en/msg_docs/VehicleStatus.html.
"""


def events_of(
    channels: Mapping[str, Channel], stated: Phases, actuator: str = ""
) -> tuple[Event, ...]:
    """What a log says of itself, and what its map leaves out: disarmed, landed, modes.

    The names of ArduPilot's modes depend on the vehicle, and so on its kind of `actuator`.
    """
    said = list(_SAID)
    for name in channels:
        last = name.rsplit("/", 1)[-1].lower()
        if name == stated.armed or (stated.armed is None and last in _ARMED):
            said.append(("disarmed", name, frozenset({0.0}), True))
        if name == stated.landed or (stated.landed is None and last in ("landed", "is_landed")):
            said.append(("landed", name, frozenset({0.0}), False))
    found = [Event("left out", a, b, "map.toml") for a, b in stated.leave_out]
    for kind, name, values, these in said:
        if name in channels:
            t, x = channels[name]
            found += _spans(kind, t, np.isin(x, list(values)) == these, name)
    for kind, name, begins, ends in _CHANGES:
        if name in channels:
            found += _between(kind, channels[name], begins, ends, name)
    if {"ERR/Subsys", "ERR/ECode"} <= channels.keys():
        t, code = channels["ERR/ECode"]
        own = channels["ERR/Subsys"].values == _CRASH
        crashed = Channel(t[own], np.where(code[own] == 0, 0.0, 1.0))
        found += _between("after an impact", crashed, (1,), (0,), "ERR/Subsys")
    found += _modes(channels, stated, actuator)
    return tuple(dict.fromkeys(found))


def _between(
    kind: Kind, channel: Channel, begins: tuple[int, ...], ends: tuple[int, ...], column: str
) -> list[Event]:
    """The spans between changes that begin and that end a state."""
    t, x = channel
    some = np.isin(x, (*begins, *ends))
    if not some.any():
        return []
    held = np.r_[x[some][0] in ends, np.isin(x[some], begins)]
    return _spans(kind, np.r_[-np.inf, t[some]], held, column)


def _modes(channels: Mapping[str, Channel], stated: Phases, actuator: str) -> list[Event]:
    """The spans of a controller's modes, by the first column that tells them."""
    named = [name for name in channels if name.rsplit("/", 1)[-1].lower() in _MODE]
    wanted = (stated.mode or "", "MODE/ModeNum", "MODE/Mode", _OF_PX4, *named)
    column = next(filter(channels.__contains__, wanted), None)
    if column is None:
        return []
    t, x = channels[column]
    present = np.isfinite(x)
    t, x = t[present], x[present]
    if not len(x) or (x % 1).any() or len(np.unique(x)) > _MOST_MODES:
        return []
    names: Sequence[str] = ()
    if column == _OF_PX4:
        names = _PX4.split(", ")
    elif column.startswith("MODE/"):
        names = _OF_ARDUPILOT.get(actuator, "").split(", ")
    found: list[Event] = []
    for value in np.unique(x).astype(int).tolist():
        known = names[value] if 0 <= value < len(names) else ""
        found += [
            Event("mode", event.start, event.end, column, known or f"{value}")
            for event in _spans("left out", t, x == value, column)
        ]
    return sorted(found, key=lambda event: event.start)


def _spans(kind: Kind, t: Array, holds: np.ndarray, column: str) -> list[Event]:
    """The spans in which a state holds that is known at times t (N,) [s], until the next."""
    edges = np.r_[-np.inf, t[1:], np.inf]
    return [Event(kind, edges[a], edges[b], column) for a, b in signals.runs(holds)]


class _Parts(NamedTuple):
    """Means of a log over parts of a tenth of a second."""

    first: np.ndarray  # (K,) first sample of every part
    v: Array  # (K, n) velocities
    still: np.ndarray  # (K,) whether nothing moves for half a second about it
    calm: np.ndarray  # (K,) whether nothing moves in it
    slow: np.ndarray  # (K,) whether it hardly drifts
    force: Array  # (K, n) that the motors exert by the published values
    missing: Array  # (K, n) force that would have to act besides to move it as it moves
    groups: Array  # (g, n) 1 at the velocities of a unit
    weight: float  # less buoyancy [N], or a planar vehicle's 0

    def norms(self, x: Array) -> Array:
        """(K, g) norms of x (K, n) over the velocities of either unit."""
        return np.sqrt(x**2 @ self.groups.T)


def phases(
    log: Log,
    source: str,
    robot: RobotModel,
    events: Sequence[Event],
    detect: bool = True,
    first_measured: int = 0,
) -> list[LogPhase]:
    """The phases of a stretch of a log without gaps, in order of time.

    Of a vehicle whose velocities before `first_measured` are not measured, the others tell them.

    Those of a tree of joints, whose rows at rest are left out joint by joint, follow from events
    alone; so do those of a vehicle unless they are to be found from its signals (`detect`).
    """
    step = float(log.t[-1] - log.t[0]) / (len(log.t) - 1)
    width = max(1, round(_PART / step))
    first = np.arange(0, max(len(log.t) // width, 1)) * width
    kinds = np.full(len(first), "moving", dtype=object)
    reasons: dict[str, str] = {}
    if detect and robot.prior is not None and len(first) >= 3 * _WINDOW:
        noise = _noises(log, step, width)
        kinds, reasons = _by_signals(_parts(log, robot, first, noise, first_measured))
    modes = tuple(event for event in events if event.kind == "mode")
    for event in events:
        if event.kind == "mode":
            continue
        inside = (log.t[first] < event.end) & (log.t[first] + _PART > event.start)
        kinds[inside] = event.kind
        reasons[event.kind] = f"{event.column} says so"
    kinds = _absorbed(kinds)
    found = []
    edges = [0, *(np.flatnonzero(kinds[1:] != kinds[:-1]) + 1).tolist(), len(kinds)]
    for a, b in itertools.pairwise(edges):
        last = first[b] if b < len(first) else len(log.t)
        own = log.part(first[a], last)
        found.append(LogPhase(kinds[a], source, own, reasons.get(kinds[a], ""), modes))
    return found


def _absorbed(kinds: np.ndarray) -> np.ndarray:
    """(K,) the kinds, without moments of one between or beside others that are left out, too."""
    found = kinds.copy()
    out = ~np.isin(kinds, USED)
    for a, b in signals.runs(out):
        edges = [a, *(np.flatnonzero(kinds[a + 1 : b] != kinds[a : b - 1]) + a + 1).tolist(), b]
        spans = list(itertools.pairwise(edges))
        longest = max(spans, key=lambda span: span[1] - span[0])
        for first, last in spans:
            if last - first < _MOMENT:
                found[first:last] = kinds[first - 1] if first > a else kinds[longest[0]]
    return found


def _noises(log: Log, step: float, width: int) -> Array:
    """(n,) standard deviations of noise in the means of parts, where the log is quiet."""
    length = max(width * _WINDOW, round(1 / step))
    starts = range(0, max(len(log.t) - length, 1), length)
    every = [[signals.noise(x) for x in log.v[k : k + length].T] for k in starts]
    return np.quantile(np.array(every), 0.2, axis=0) / np.sqrt(width)


def _parts(
    log: Log, robot: RobotModel, first: np.ndarray, noise: Array, first_measured: int
) -> _Parts:
    """The parts of a vehicle's log, with forces by its published values."""
    system = robot.system
    counts = np.diff([*first, len(log.t)])[:, None]
    v, u, t = (np.add.reduceat(x, first) / counts for x in (log.v, log.u, log.t[:, None]))
    units = dict.fromkeys(system.velocity_units[first_measured:])
    groups = np.array([[float(own == unit) for own in system.velocity_units] for unit in units])
    speed = np.sqrt(v**2 @ groups.T)
    least = np.quantile(speed, _FAST, axis=0)
    least = np.maximum(_STILL * least, _NOISE * np.sqrt(noise**2 @ groups.T))
    energy = ndimage.uniform_filter1d(speed**2, _WINDOW, axis=0, mode="nearest")
    still = np.all(np.sqrt(energy) < least, axis=1)
    smooth = ndimage.uniform_filter1d(v, _WINDOW, axis=0, mode="nearest")
    smooth[still] = 0.0  # a wheel's slip is the ratio of two speeds, and here of their noise
    a = np.gradient(smooth, t[:, 0], axis=0)
    a[still] = 0.0
    v = np.where(still[:, None], 0.0, v)
    middle = first + counts[:, 0] // 2
    x = np.hstack([log.q[middle], v])
    W = system.regressor(t[:, 0], x, v, a, u)
    W = np.where(np.isfinite(W), W, 0.0)
    columns = system.structure.columns
    commanded = sorted({c.parameter for c in columns if c.input >= 0})
    assert robot.prior is not None
    force = -W[:, :, commanded] @ robot.prior[commanded]
    none = np.zeros_like(v)
    x = np.hstack([log.q[middle], none])
    at_rest = system.regressor(t[:, 0], x, none, none, np.zeros_like(u)) @ robot.prior
    weight = np.sqrt(np.where(np.isfinite(at_rest), at_rest, 0.0) ** 2 @ groups[0])
    calm = np.all(speed < least, axis=1)
    slow = np.all(speed < _DRIFTS * least, axis=1)
    missing = W @ robot.prior
    net = 0.0 if first_measured else float(np.median(weight))  # nothing tells what carries it
    return _Parts(first, v, still, calm, slow, force, missing, groups, net)


def _by_signals(parts: _Parts) -> tuple[np.ndarray, dict[str, str]]:
    """(K,) kind of every part of a vehicle's log, and the reasons of the kinds."""
    still = parts.still
    force = parts.norms(parts.force)
    large = np.maximum(np.quantile(force, _FAST, axis=0), 1e-12)
    change = _change(parts, _WINDOW) / large
    off = np.all((force < _OFF * large) & (change < _CONSTANT), axis=1)
    usual = ~still & ~off
    if not usual.any():
        usual = np.ones(len(off), bool)
    supported = bool(parts.weight > _SUPPORT * np.median(force[usual, 0]))
    scale = large.copy()
    if supported:
        scale[0] = parts.weight
    missing = ndimage.uniform_filter1d(parts.missing, _WINDOW, axis=0, mode="nearest")
    lacks = parts.norms(missing - np.median(missing[usual], axis=0)) / scale
    kinds = np.full(len(off), "airborne" if supported else "moving", dtype=object)
    rest = _long(still & off)
    held = still & ~off & np.any(lacks > _UNBALANCED, axis=1)
    if supported:
        carried = _long(~still & off & (lacks[:, 0] > _SUPPORT))
        kinds[_wider(carried, ~parts.calm & (lacks[:, 0] > _UNBALANCED))] = "carried"
    else:
        held &= np.any(_change(parts, 4 * _WINDOW) / large > _PUSHES, axis=1)
    held = _long(held)
    kinds[_wider(held, parts.calm)] = "held"
    kinds[_wider(rest, (parts.calm | (parts.slow & off)) & ~held)] = "at rest"
    reasons = {
        "at rest": "nothing moves and the motors are off, so what carries it is unknown",
        "held": "nothing moves while the motors push: something holds it",
        "carried": "it does not fall while the motors hardly carry it",
    }
    return _with_impacts(kinds, parts, reasons), reasons


def _change(parts: _Parts, count: int) -> Array:
    """(K, g) largest change of the motors' force within so many parts, over either unit."""
    most = ndimage.maximum_filter1d(parts.force, count, axis=0, mode="nearest")
    least = ndimage.minimum_filter1d(parts.force, count, axis=0, mode="nearest")
    return parts.norms(most - least)


def _long(chosen: np.ndarray) -> np.ndarray:
    """(K,) the parts in runs of at least half a second."""
    found = np.zeros(len(chosen), bool)
    for a, b in signals.runs(chosen):
        found[a:b] = b - a >= _WINDOW
    return found


def _wider(chosen: np.ndarray, alike: np.ndarray) -> np.ndarray:
    """(K,) the parts, those of a touch-down before and of lifting off after them.

    Both judge half a second about a part, and so begin late and end early: `alike` (K,) parts
    beside them belong to them.
    """
    found = chosen.copy()
    for a, b in signals.runs(chosen):
        end = b
        while end < len(chosen) and alike[end]:
            end += 1
        found[max(a - _TOUCHES, 0) : end + _LEAVES] = True
    return found


def _with_impacts(kinds: np.ndarray, parts: _Parts, reasons: dict[str, str]) -> np.ndarray:
    """(K,) the kinds, where an impact up to three seconds before a phase of rest begins it."""
    jump = parts.norms(np.diff(parts.v, axis=0, prepend=parts.v[:1]))
    usual = np.isin(kinds, USED)
    starts = [a for a, _ in signals.runs(~usual) if a > 0]
    for a in starts:
        usual[max(a - _BEFORE, 0) : a + _LEAVES] = False
    if not usual.any():
        return kinds
    most = np.maximum(np.quantile(jump[usual], _LARGEST, axis=0), 1e-12)
    found = kinds.copy()
    for a in starts:
        begin = max(a - _BEFORE, 0)
        hard = np.flatnonzero(np.any(jump[begin:a] > _IMPACT * most, axis=1)) + begin
        hard = hard[np.isin(kinds[hard], USED)]
        if len(hard):
            found[max(hard[0] - 1, 0) : a] = "after an impact"
            times = number(float((jump[hard[0]] / most).max()), significant=2)
            reasons["after an impact"] = f"its velocity jumps {times} times as far as elsewhere"
    return found


def parts_in_words(found: Sequence[LogPhase]) -> str:
    """The part of the logs of which a result speaks, in a sentence; "" if it is the whole."""
    out: dict[str, float] = {}
    for phase in found:
        if not phase.used:
            out[phase.kind] = out.get(phase.kind, 0.0) + phase.seconds
    if not out:
        return ""
    total = number(sum(phase.seconds for phase in found), significant=3)
    used = number(sum(phase.seconds for phase in found if phase.used), significant=3)
    each = ", ".join(f"{kind} {number(x, significant=2)} s" for kind, x in out.items())
    return f"This is said of {used} of {total} s of the log; left out: {each}."


def phases_stated(found: Sequence[LogPhase], level: Literal["note", "warning"]) -> list[Finding]:
    """The finding about phases that take no part in the fit; none if all do."""
    out = [phase for phase in found if not phase.used]
    if not out:
        return []
    total = sum(phase.seconds for phase in found)
    used = sum(phase.seconds for phase in found if phase.used)
    text = f"{number(used, significant=3)} of {number(total, significant=3)} s are fitted; "
    text += "left out: " + "; ".join(
        f"{phase.log.t[0]:.1f} to {phase.log.t[-1]:.1f} s {phase.kind} ({phase.why})"
        for phase in out[:_LISTED]
    )
    text += f"; and {len(out) - _LISTED} more" if len(out) > _LISTED else ""
    keys = ("file", "span", "kind", "why")
    table = [dict(zip(keys, phase.row, strict=True)) for phase in found]
    files = list(dict.fromkeys(phase.source for phase in out))
    data = {"used": used, "seconds": total, "phases": table}
    where = files[0] if len(files) == 1 else ""
    return [Finding(level, "phases", where, text, data=data)]


def events_stated(source: str, events: Sequence[Event], start: float, end: float) -> list[Finding]:
    """The finding about spans of a log, from start to end [s], that its own events leave out."""
    spans = [(max(e.start, start), min(e.end, end), e) for e in events if e.kind != "mode"]
    out = [(a, b, e) for a, b, e in spans if b > a]
    if not out:
        return []
    each = [f"{a:.1f} to {b:.1f} s {e.kind} ({e.column} says so)" for a, b, e in out[:_LISTED]]
    text = f"left out: {'; '.join(each)}"
    text += f"; and {len(out) - _LISTED} more" if len(out) > _LISTED else ""
    data = {"phases": [{"span": [a, b], "kind": e.kind, "column": e.column} for a, b, e in out]}
    return [Finding("note", "phases", source, text, data=data)]


def modes_stated(found: Sequence[LogPhase]) -> list[Finding]:
    """The note of a controller's modes in each log; none without any."""
    notes = []
    for source in dict.fromkeys(phase.source for phase in found):
        modes = [mode for phase in found if phase.source == source for mode in phase.own_modes]
        joined: list[Event] = []
        for mode in modes:  # a mode goes on through several phases
            if joined and joined[-1].name == mode.name:
                joined[-1] = joined[-1]._replace(end=mode.end)
            else:
                joined.append(mode)
        if not joined:
            continue
        each = [f"{m.name} {m.start:.1f} to {m.end:.1f} s" for m in joined[:_LISTED]]
        text = f"modes of the controller ({joined[0].column}): {', '.join(each)}"
        text += f"; and {len(joined) - _LISTED} more" if len(joined) > _LISTED else ""
        text += ". A mode changes the commands, not what they do: no part is left out for it"
        data = {"modes": [{"mode": m.name, "span": [m.start, m.end]} for m in joined]}
        notes.append(Finding("note", "modes", source, text, data=data))
    return notes


_LISTED = 6  # phases named in a message
