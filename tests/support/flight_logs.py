"""A simulated flight as PX4 logs it, and minimal ULog and DataFlash files, byte by byte."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import scipy.signal
from scipy.spatial.transform import Rotation

from nsaid_mj.core.log import Log

Topics = dict[str, tuple[dict[str, np.ndarray], np.ndarray]]
"""By topic or kind of message: fields, (N,) or (N, k) for an array of k, and times (N,) [s]."""

NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD = np.diag([1.0, -1.0, -1.0])
MOTORS = [1, 3, 0, 2]  # rotor of motors 1 to 4: front right, rear left, front left, rear right


def commands(log: Log, mix: float, dead: float = 0.0) -> np.ndarray:
    """(N, 4) commands of motors 1 to 4 for which the rotors' speeds are those of a log.

    The motors begin to turn at the command `dead`.
    """
    thrust = log.u[:, MOTORS] ** 2  # = mix u² + (1 − mix) u
    if mix == 0:
        return dead + (1 - dead) * thrust
    half = (1 - mix) / (2 * mix)
    return dead + (1 - dead) * (np.sqrt(half**2 + thrust / mix) - half)


def topics(log: Log, mix: float = 0.0, dead: float = 0.0) -> Topics:
    """A quadrotor's log as PX4 has it: each topic at its own rate, noisy, without a position."""
    rng = np.random.default_rng(0)
    turn = Rotation.from_quat(log.q[:, 3:])
    attitude = Rotation.from_matrix(NED.T @ (turn.as_matrix() @ FRD))
    attitude = attitude * Rotation.from_rotvec(1e-3 * rng.normal(size=(len(log.t), 3)))
    velocity = turn.apply(log.v[:, :3]) @ NED.T + 0.02 * rng.normal(size=(len(log.t), 3))
    rates = log.v[:, 3:] @ FRD + 0.01 * rng.normal(size=(len(log.t), 3))
    every = slice(None, None, 2)
    quaternions = attitude.as_quat(scalar_first=True)
    return {
        "vehicle_attitude": ({"q": quaternions[every]}, log.t[every] + 1),
        "vehicle_angular_velocity": ({"xyz": rates}, log.t + 1),
        "vehicle_local_position": (
            dict(zip(("vx", "vy", "vz"), velocity[every].T, strict=True)),
            log.t[every] + 1,
        ),
        "actuator_motors": ({"control": commands(log, mix, dead)}, log.t + 1),
    }


def speeds(log: Log, rate: float, lag: float, delay: float, top: float) -> Topics:
    """The measured speeds of rotors that lag behind a log's commands, as PX4 has them [rpm].

    The lag and the delay [s] are those of the plant, `top` is the speed at full command [rad/s].
    """
    step = float(np.median(np.diff(log.t)))
    late = np.vstack([np.repeat(log.u[:1], round(delay / step), axis=0), log.u])[: len(log.u)]
    kept = np.exp(-step / lag)
    own = np.vstack([late[:1], late[:-1]])  # a command acts from its sample on
    true = scipy.signal.lfilter([1 - kept], [1, -kept], own, axis=0, zi=kept * own[:1])[0]
    t = np.arange(log.t[0], log.t[-1], 1 / rate)
    rpm = np.array([np.interp(t, log.t, x * top * 30 / np.pi) for x in true[:, MOTORS].T])
    rpm = np.round(rpm + 20 * np.random.default_rng(1).normal(size=rpm.shape))
    return {"esc_status": ({f"esc[{i}].esc_rpm": x for i, x in enumerate(rpm)}, t + 1)}


def write_ulog(path: Path, topics: Topics) -> Path:
    """A ULog of topics of doubles."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    parts = [b"ULog\x01\x12\x35\x01" + bytes(8), message(b"B", bytes(40))]
    for topic, (columns, _) in topics.items():
        fields = "uint64_t timestamp;" + "".join(
            f"double{'' if x.ndim == 1 else f'[{x.shape[1]}]'} {name};"
            for name, x in columns.items()
        )
        parts.append(message(b"F", f"{topic}:{fields}".encode()))
    for number, topic in enumerate(topics):
        parts.append(message(b"A", struct.pack("<BH", 0, number) + topic.encode()))
    for number, (columns, t) in enumerate(topics.values()):
        table = np.column_stack(list(columns.values()))
        for stamp, row in zip(np.round(t * 1e6).astype(np.uint64).tolist(), table, strict=True):
            parts.append(message(b"D", struct.pack(f"<HQ{len(row)}d", number, stamp, *row)))
    path.write_bytes(b"".join(parts))
    return path


def write_dataflash(path: Path, kinds: Topics, clock: str = "TimeUS") -> Path:
    """A DataFlash log of kinds of messages with floats, or bytes, one number a field.

    `clock` is the field of the time; `TimeMS` of old firmware is in milliseconds.
    """
    time, ticks = ("Q", 1e6) if clock == "TimeUS" else ("I", 1e3)

    def declared(number: int, length: int, name: str, types: str, labels: str) -> bytes:
        texts = (name.encode(), types.encode(), labels.encode())
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, *texts)

    parts = [declared(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    for number, (kind, (columns, _)) in enumerate(kinds.items(), start=0x90):
        types = time + "".join("B" if x.dtype == np.uint8 else "f" for x in columns.values())
        length = 3 + struct.calcsize(f"<{types}")
        parts.append(declared(number, length, kind, types, ",".join([clock, *columns])))
    for number, (columns, t) in enumerate(kinds.values(), start=0x90):
        for k, stamp in enumerate(np.round(t * ticks).astype(np.uint64).tolist()):
            own = [c[k] for c in columns.values()]
            types = "".join("B" if x.dtype == np.uint8 else "f" for x in own)
            row = struct.pack(f"<{time}{types}", stamp, *own)
            parts.append(b"\xa3\x95" + bytes([number]) + row)
    path.write_bytes(b"".join(parts))
    return path
