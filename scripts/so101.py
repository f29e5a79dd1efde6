"""Servo parameters from logs of a real SO-101: how well they predict motions not seen.

    python scripts/so101.py FOLDER   # with so101.xml and logs NAME.csv.gz

Leaves one log out at a time: mean absolute error of open-loop simulations by MuJoCo of that log,
driven by its targets alone, with the identified file and with the user's own. Then the same fit
from other kp in the model file, and the agreement between disjoint halves of the logs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy import stats

from nsaid_mj.clinic.servos.export import rollout, write_servo_mjcf
from nsaid_mj.clinic.servos.fit import GRAVITY
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.clinic.servos.logs import ServoLogs
from nsaid_mj.clinic.servos.result import ServoIdentification

HALVES = 7


def main() -> None:
    """Prints the three tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    files = sorted(folder.glob("*.csv.gz"))
    given = servo_logs(folder / "so101.xml", files)
    assert given is not None
    identify_servos(given._replace(logs=given.logs[:1]))  # compiles
    leave_one_out(given)
    priors(folder / "so101.xml", files)
    halves(given)


def error(
    given: ServoLogs,
    path: Path,
    k: int,
    delay: float | None = None,
    used: np.ndarray | float = 1.0,
) -> np.ndarray:
    """(n,) mean absolute errors of log k [mrad], by a file, with its delays or another [s].

    Of the samples that `used` (N,) marks by 1.
    """
    log = given.logs[k]
    found = rollout(path, given.robot.joints, log, delay)
    weight = np.broadcast_to(used, len(log.t))
    return 1e3 * weight @ np.abs(found - log.position) / weight.sum()


def leave_one_out(given: ServoLogs) -> None:
    """The table of errors on logs that took no part in the fit.

    The last row leaves out the windows that a fit of all logs takes for external forces: there the
    gripper rests on the table, which no servo's model knows.
    """
    print("| log left out | " + " | ".join(given.robot.joints) + " | mean | file | CPU s |")
    print("|" + "---|" * (len(given.robot.joints) + 4))
    rows, late, before, free = [], [], [], []
    used = np.split(identify_servos(given).used, np.cumsum([len(x.t) for x in given.logs])[:-1])
    for k, log in enumerate(given.logs):
        rest = given._replace(logs=given.logs[:k] + given.logs[k + 1 :])
        begin = time.process_time()
        result = identify_servos(rest)
        seconds = time.process_time() - begin
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "identified.xml")
            write_servo_mjcf(result, path)
            rows.append(error(given, path, k))
            late.append(error(given, path, k, 0.0))
            free.append(error(given, path, k, used=used[k]))
        assert given.robot.source is not None
        before.append(error(given, given.robot.source, k))
        cells = " | ".join(f"{x:.1f}" for x in [*rows[-1], rows[-1].mean(), before[-1].mean()])
        print(f"| {log.source.partition('.')[0]} | {cells} | {seconds:.0f} |", flush=True)
    cells = " | ".join(f"{x:.1f}" for x in [*np.mean(rows, axis=0), np.mean(rows), np.mean(before)])
    print(f"| mean | {cells} | |")
    cells = " | ".join(f"{x:.1f}" for x in [*np.nanmean(free, axis=0), np.nanmean(free)])
    print(f"| mean without contact | {cells} | | |")
    print(f"\nwithout the delays: {np.mean(late):.1f} mrad in the mean")


def priors(model: Path, files: list[Path]) -> None:
    """Largest relative difference of any number between model files with other kp."""
    found = []
    for kp in (5, 48, 998.22):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "arm.xml")
            path.write_text(model.read_text().replace('kp="998.22"', f'kp="{kp}"'))
            given = servo_logs(path, files)
            assert given is not None
            found.append([p.value for p in identify_servos(given).parameters])
    spread = np.ptp(np.log(found), axis=0).max()
    print(f"\nkp 5, 48 and 998 in the file: numbers differ by {100 * spread:.2g} % at most")


def halves(given: ServoLogs) -> None:
    """How often 95 % intervals of disjoint halves overlap, and hold the other's value.

    Also the rms of z, their difference over its deviation, which is 1 for exact intervals: of the
    numbers whose intervals are within a factor of e in both.
    """
    rng, overlap, hold, sure, z = np.random.default_rng(0), {}, {}, [], {}
    for _ in range(HALVES):
        order = rng.permutation(len(given.logs))
        parts = (order[: len(order) // 2], order[len(order) // 2 :])
        results = [
            identify_servos(given._replace(logs=tuple(given.logs[i] for i in part)))
            for part in parts
        ]
        for a, b in zip(*(r.parameters for r in results), strict=True):
            if "gravity does not determine" in a.combination + b.combination:
                continue
            widths = [np.log(p.high / p.value) for p in (a, b)]
            held = a.low <= b.value <= a.high and b.low <= a.value <= b.high
            for name in (a.name.partition("_")[0], "all"):
                overlap.setdefault(name, []).append(max(a.low, b.low) <= min(a.high, b.high))
                hold.setdefault(name, []).append(held)
                if max(widths) < 1:
                    apart = 1.96 * np.log(a.value / b.value) / np.hypot(*widths)
                    z.setdefault(name, []).append(float(apart))
                    if name == "kp":
                        z.setdefault("kp without offset", []).append(_of_kp(results, a.name))
            if a.status == b.status == "identified":
                sure.append(held)
    print(f"\n| of {HALVES} disjoint halves | " + " | ".join(overlap) + " |")
    print("|" + "---|" * (len(overlap) + 1))
    for words, found in (("intervals overlap", overlap), ("each contains the other's value", hold)):
        print(f"| {words} | " + " | ".join(f"{np.mean(v):.2f}" for v in found.values()) + " |")
    rms = ", ".join(f"{k} {np.sqrt(np.mean(np.square(v))):.2f} ({len(v)})" for k, v in z.items())
    print(f"\nrms of z (pairs): {rms}")
    print(f"of the {len(sure)} pairs that both halves call identified: {np.mean(sure):.2f}")
    each = len(given.logs) // 2
    print(f"exact 95 % intervals from {each} logs: {nominal(each):.2f}")


def _of_kp(results: list[ServoIdentification], name: str) -> float:
    """z of a joint's kp without what the zero of its encoder changes, as both halves share it."""
    joints = [result.joints[int(name.rpartition("_")[2]) - 1] for result in results]
    own = [joint.covariance[GRAVITY, GRAVITY] - joint.offset**2 for joint in joints]
    return float((joints[0].x[GRAVITY] - joints[1].x[GRAVITY]) / np.sqrt(sum(own)))


def nominal(logs: int) -> float:
    """How often exact 95 % intervals of two estimates each hold the other's value, by simulation.

    Args:
        logs: independent ones of each half, which its mean and Student's t-interval come from.
    """
    samples = np.random.default_rng(0).normal(size=(2, 200_000, logs))
    apart = np.abs(np.diff(samples.mean(axis=2), axis=0)[0])
    half = stats.t.ppf(0.975, logs - 1) * samples.std(axis=2, ddof=1) / np.sqrt(logs)
    return float(np.mean(apart <= half.min(axis=0)))


if __name__ == "__main__":
    main()
