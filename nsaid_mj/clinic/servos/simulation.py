"""One servo-driven joint, simulated open loop from its targets: exact Coulomb stick–slip.

Divided by the servo's stiffness kp, joint j of an arm obeys

    (a + g M_jj) q̈ = u(t − d) − q − T q̇ − f sgn q̇ − g Γ_j(q),

with g = 1/kp [rad/(N·m)], T = (kv + damping)/kp [s], f = friction/kp [rad], a = armature/kp [s²]
and the target's delay d [s]. Gravity Γ_j and inertia M_jj are those of the model file at the
measured positions. Γ_j includes what the other joints' speeds and accelerations exert on this one:
the latter are those of a simulation of all joints together, which decouples the joints' fits.
"""

from typing import NamedTuple

import numpy as np

from ...core import Array, kernel

STEP = 4e-3
"""Longest step of the simulation [s]."""
_FINER = 4.0  # the same over that of a gear's play
_ITERATIONS = 30  # over joints at most; until speeds change less [rad/s or m/s]
_SAME = 1e-7
FALL = 0.1  # speed at which Stribeck friction has fallen to 1/e [rad/s or m/s]


class JointLog(NamedTuple):
    """One joint's part of a log of N samples."""

    t: Array  # (N,) times [s], strictly increasing
    target: Array  # (N,) target of the servo [rad or m], held until the next sample
    position: Array  # (N,) measured [rad or m]
    load: Array  # (N,) torque or force that the arm requires of the joint beside M_jj q̈ [N·m or N]
    inertia: Array  # (N,) M_jj without armature [kg·m² or kg]
    limit: float = np.inf  # largest torque or force of the servo [N·m or N]
    stiffer: float = 1.0  # kp in this log over that of θ

    def own(self, theta: Array) -> Array:
        """(..., 5) θ with this log's kp."""
        return theta / [*4 * (self.stiffer,), 1.0]


class Effects(NamedTuple):
    """Effects beyond the equation above."""

    stribeck: float = 0.0  # excess of friction over kp at rest, which falls with speed [rad or m]
    load: float = 0.0  # friction per torque of the load [1]


NONE = Effects()
COLUMNS = 8
"""Derivatives of a position: by ln θ (5,), by the two effects, and 0, for whole registers."""


def simulate(log: JointLog, theta: Array, effects: Effects = NONE) -> Array:
    """(N,) positions of a joint that starts at rest at its first measured position.

    theta (5,) are T [s], f [rad], g [rad/(N·m)], a [s²], d [s]; of a slide in m instead of rad.
    """
    return _moved(log, theta, effects, 0)[0]


def differentiated(log: JointLog, theta: Array, effects: Effects = NONE) -> tuple[Array, Array]:
    """(N,) positions, as `simulate`, and (N, 7) derivatives by ln θ and by the effects.

    They are exact: a step's position is continuous in θ, also where the joint sticks or slips.
    """
    q, slope = _moved(log, theta, effects, len(log.t))
    return q, slope[:, :-1]


def _moved(log: JointLog, theta: Array, effects: Effects, rows: int) -> tuple[Array, Array]:
    out = np.empty(len(log.t))
    out[0] = log.position[0]
    slope = np.zeros((rows, COLUMNS))
    apart = log.t, log.target, log.load, log.inertia, log.limit
    move(*apart, log.own(theta), effects, STEP, out, slope)
    return out, slope


@kernel(error_model="numpy")
def _area(t, target, held, begin, h):
    """Integral of a target from `begin` over h, and the number of that in force at `begin`."""
    end = len(t) - 1
    while held < end and t[held + 1] <= begin:
        held += 1
    at = begin
    k = held
    area = 0.0
    while k < end and t[k + 1] < begin + h:
        area += target[k] * (t[k + 1] - at)
        at = t[k + 1]
        k += 1
    return area + target[k] * (begin + h - at), held


@kernel(error_model="numpy")
def _held(t, target, held, end):
    """The target in force just before a time, not before number `held`."""
    while held < len(t) - 1 and t[held + 1] < end:
        held += 1
    return target[held]


@kernel(error_model="numpy")
def _share(decay):
    """Share of a step's end in its mean speed, from h T/J."""
    return 1 / (1 - np.exp(-decay)) - 1 / decay if decay > 1e-3 else 0.5


@kernel(error_model="numpy")
def _slopes(of_J, of_part, decay, a, moved):
    """The derivatives of J = a + `moved`, and those of `_share`, by ln θ."""
    rise = decay / 12
    if decay > 1e-3:
        left = np.exp(-decay)
        rise = 1 / decay - decay * left / (1 - left) ** 2
    of_J[2] = moved
    of_J[3] = a
    of_part[0] = rise
    of_part[2] = -rise * moved / (a + moved)
    of_part[3] = -rise * a / (a + moved)


@kernel(error_model="numpy")
def _carry(
    of_q, of_v, of_J, of_part, of_drive, inverse, kept, pull, braked, change, early, late, h
):
    """The derivatives of a step's position and speed, from those before it."""
    for k in range(COLUMNS):
        new = (of_J[k] + braked * of_part[k]) * change + kept * of_v[k] - pull * of_q[k]
        new = inverse * (new + of_drive[k])
        of_q[k] += early * of_v[k] + late * new - h * of_part[k] * change
        of_v[k] = new


@kernel(error_model="numpy")
def move(t, target, load, inertia, limit, theta, effects, longest, out, slope):
    """Writes the positions after the first sample to `out` (N,), whose first entry is the start.

    Steps of the θ-method; the joint sticks where friction can hold what drives it. θ between 1/2
    and 1 makes the decay of a speed by damping alone, exp(−h T/J), exact, so that steps may be
    longer than J/T. The target is averaged over each step after its delay, so that positions are
    continuous in it. A servo that saturates exerts its largest force over a step.

    The derivatives of the positions by ln θ and by `effects` are written to `slope` (N, `COLUMNS`),
    or nowhere if it has no rows. They obey the derivative of each step: a joint that sticks keeps
    those of its position, and forgets those of its speed.
    """
    T, f, g, a, d = theta
    stribeck, rising = effects
    of_q, of_v, of_J, of_part, of_drive = np.zeros((5, COLUMNS))
    q = out[0]
    v = 0.0
    held = 0
    for i in range(len(t) - 1):
        steps = int(np.ceil((t[i + 1] - t[i]) / longest))
        h = (t[i + 1] - t[i]) / steps
        moved = g * (inertia[i] + inertia[i + 1]) / 2
        J = a + moved
        resisted = h * T + h * h / 2
        part = _share(h * T / J)
        if len(slope):
            _slopes(of_J, of_part, h * T / J, a, moved)
        for s in range(steps):
            begin = t[i] + s * h - d
            area, held = _area(t, target, held, begin, h)
            hold = g * (load[i] + (s + 0.5) / steps * (load[i + 1] - load[i]))
            error = area - h * q
            fallen = np.exp(-((v / FALL) ** 2)) if stribeck > 0 or len(slope) else 0.0
            grip = h * (f + rising * abs(hold) + stribeck * fallen)
            kept = J - (1 - part) * resisted
            m = J + part * resisted
            drive = kept * v + error - h * hold
            before = v
            v = 0.0
            if abs(drive) > grip:
                v = (drive - np.sign(drive) * grip) / m
            mean = (1 - part) * before + part * v
            servo = error - resisted * mean
            full = abs(servo) > h * g * limit
            if full:
                kept = m = J
                drive = J * before + np.sign(servo) * h * g * limit - h * hold
                v = np.sign(drive) * max(abs(drive) - grip, 0.0) / J
                mean = (1 - part) * before + part * v
            q += h * mean
            if len(slope) == 0 or (before == 0.0 and v == 0.0):
                continue
            # where it slips, v = (kept before + drive − grip) / m; a full servo feels no error
            side, free = np.sign(v), 0.0 if full else 1.0
            of_load = (np.sign(servo) * h * g * limit if full else 0.0) - h * (
                hold + side * rising * abs(hold)
            )
            of_delay = free * d * (target[held] - _held(t, target, held, begin + h))
            of_drive[:5] = -free * h * T * mean, -side * h * f, of_load, 0.0, of_delay
            of_drive[5:7] = -side * h * fallen, -side * h * abs(hold)
            kept += side * h * stribeck * 2 * before / FALL**2 * fallen
            linear = abs(side) / m, kept, free * h, free * resisted, before - v
            _carry(of_q, of_v, of_J, of_part, of_drive, *linear, h * (1 - part), h * part, h)
        out[i + 1] = q
        if len(slope):
            slope[i + 1] = of_q


def with_play(log: JointLog, theta: Array, half: float, behind: bool) -> tuple[Array, Array]:
    """(N,) positions of motor and (N,) of link, between which a gear has play of 2 `half`.

    Friction and damping are the motor's, weight and inertia the link's. The servo's error is the
    link's where its encoder is `behind` the gear, else the motor's.
    """
    motor = np.empty(len(log.t))
    link = np.empty(len(log.t))
    motor[0] = link[0] = log.position[0]
    apart = log.t, log.target, log.load, log.inertia
    move_with_play(*apart, log.own(theta), half, behind, STEP / _FINER, motor, link)
    return motor, link


@kernel(error_model="numpy")
def move_with_play(t, target, load, inertia, theta, half, behind, longest, motor, link):
    """Writes the positions of motor and link (N,) after the first sample, see `with_play`.

    Implicit Euler's steps. The two move as one while the gear is pressed to one side; where its
    force would pull they part, and where they meet again the impact is inelastic.
    """
    T, f, g, a, d = theta
    x = motor[0]
    y = link[0]
    v = 0.0
    w = 0.0
    side = 0.0 if half > 0 else 1.0
    held = 0
    for i in range(len(t) - 1):
        steps = int(np.ceil((t[i + 1] - t[i]) / longest))
        h = (t[i + 1] - t[i]) / steps
        moved = g * (inertia[i] + inertia[i + 1]) / 2
        for s in range(steps):
            area, held = _area(t, target, held, t[i] + s * h - d, h)
            hold = h * g * (load[i] + (s + 0.5) / steps * (load[i + 1] - load[i]))
            error = area - h * (y if behind else x)
            if side != 0.0:
                drive = (a + moved) * v + error - hold
                new = np.sign(drive) * max(abs(drive) - h * f, 0.0) / (a + moved + h * T + h * h)
                if half > 0 and side * (moved * (new - v) + hold) < 0:
                    side = 0.0
                    w = v
                else:
                    v = new
                    x += h * v
                    y += h * v
            if side == 0.0:
                drive = a * v + error
                stiff = 0.0 if behind else h * h
                v = np.sign(drive) * max(abs(drive) - h * f, 0.0) / (a + h * T + stiff)
                w -= hold / moved
                x += h * v
                y += h * w
                if abs(x - y) >= half:
                    side = np.sign(x - y)
                    v = (a * v + moved * w) / (a + moved)
                    y = x - side * half
        motor[i + 1] = x
        link[i + 1] = y


@kernel(error_model="numpy")
def move_arm(t, target, load, mass, limit, theta, longest, q, v):
    """Writes positions and velocities (N, n) of all joints from the first row on, see `move`.

    Steps are those of `move` with the other joints' accelerations, by Gauss–Seidel iterations:
    they converge as the mass matrix is positive definite, where simulations of single joints with
    the others' last motion do not (a heavy arm with soft servos).
    """
    n = q.shape[1]
    held = np.zeros(n, np.int64)
    change = np.zeros(n)
    now = np.zeros((7, n))
    J, part, resisted, error, hold, grip, place = now
    place[:] = q[0]
    for i in range(len(t) - 1):
        steps = int(np.ceil((t[i + 1] - t[i]) / longest))
        h = (t[i + 1] - t[i]) / steps
        M = (mass[i] + mass[i + 1]) / 2
        speed = v[i].copy()
        for j in range(n):
            T, f, g, a, _ = theta[j]
            J[j] = a + g * M[j, j]
            resisted[j] = h * T + h * h / 2
            grip[j] = h * f
            part[j] = _share(h * T / J[j])
        for s in range(steps):
            w = (s + 0.5) / steps
            for j in range(n):
                begin = t[i] + s * h - theta[j, 4]
                area, held[j] = _area(t, target[:, j], held[j], begin, h)
                error[j] = area - h * place[j]
                hold[j] = h * theta[j, 2] * ((1 - w) * load[i, j] + w * load[i + 1, j])
            for _ in range(_ITERATIONS):
                largest = 0.0
                for j in range(n):
                    g = theta[j, 2]
                    held_by = hold[j]
                    for k in range(n):
                        held_by += g * M[j, k] * change[k] if k != j else 0.0
                    drive = (J[j] - (1 - part[j]) * resisted[j]) * speed[j] + error[j] - held_by
                    slipping = max(abs(drive) - grip[j], 0.0)
                    new = np.sign(drive) * slipping / (J[j] + part[j] * resisted[j])
                    servo = error[j] - resisted[j] * ((1 - part[j]) * speed[j] + part[j] * new)
                    if abs(servo) > h * g * limit[j]:
                        drive = J[j] * speed[j] + np.sign(servo) * h * g * limit[j] - held_by
                        new = np.sign(drive) * max(abs(drive) - grip[j], 0.0) / J[j]
                    largest = max(largest, abs(new - speed[j] - change[j]))
                    change[j] = new - speed[j]
                if largest < _SAME:
                    break
            place += h * (speed + part * change)
            speed += change
        q[i + 1] = place
        v[i + 1] = speed
