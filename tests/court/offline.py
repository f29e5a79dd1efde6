"""Runs `nsaid identify` on a case's log, written as a file, with a model file of wrong masses."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.result import Identification
from nsaid_mj.clinic.identify.verdict import verdict
from nsaid_mj.clinic.logs.unusable import UnusableLog
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.robots.assets import packed_robots

from .cases import Case
from .judging import Judgement
from .robots import with_wrong_masses
from .simulation import Simulated, joint_names, simulated

HALF_WIDTHS = 3.0  # largest error of an identified parameter [half-widths of its interval]
LEAST = 0.05  # relative error from which it can be wrong
WIDE = 0.5  # relative half-width of a ratio from which it says nothing
_MASSES = 0.25  # largest relative error of the model file's masses
_RATES = (500.0, 250.0, 100.0, 50.0)  # of the log [Hz], each one half as likely as the one before


def judged_offline(case: Case) -> Judgement:
    """Simulates a case, identifies its robot from files, and judges the result."""
    found = simulated(case)
    rng = case.stream(7)
    constants = np.ones(found.setup.system.n_u)
    with tempfile.TemporaryDirectory() as folder:
        model, log, constants, known = _files(found, Path(folder), rng)
        try:
            result = identify_forces(
                model, log, known=known, lock=_fingers(found)[:1]
            )  # others mimic it
        except UnusableLog as error:
            codes = [finding.code for finding in error.findings if finding.level == "refusal"]
            return Judgement(flagged=[f"the log is refused: {', '.join(codes)}"])
    return judge(result, found, constants)


def _fingers(found: Simulated) -> list[str]:
    if found.case.kind != "arm":
        return []
    return [name for name in joint_names(found.setup) if "finger" in name]


def _files(
    found: Simulated, folder: Path, rng: np.random.Generator
) -> tuple[str, Path, Array, dict[str, float]]:
    """Model, log, (n_u,) actuators' true constants per logged unit over their gains, known ones."""
    system, truth = found.setup.system, found.setup.plant.truth
    rate = float(rng.choice(_RATES, p=np.array([8, 4, 2, 1]) / 15))
    velocities, anchored = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    if found.case.kind != "arm":
        return found.case.robot, _vehicle_log(found, folder), np.ones(system.n_u), {}
    gain = truth[system.space["motor gain"]]
    constants = 10.0 ** rng.uniform(-1.0, 1.0, system.n)
    path = _csv(folder / "log.csv", arm_table(found, rate, velocities, gain / constants))
    urdf = found.urdf or packed_robots()[found.case.robot].read_text("utf-8")
    model = folder / "model.urdf"
    model.write_text(with_wrong_masses(urdf, rng, _MASSES), encoding="utf-8")
    return str(model), path, constants / gain, {"gain_1": float(constants[0])} if anchored else {}


def arm_table(
    found: Simulated, rate: float, velocities: bool, units: Array
) -> dict[str, np.ndarray]:
    """The log's columns at a rate [Hz], commands in units (n,) of amperes per command."""
    log, system = found.log, found.setup.system
    assert isinstance(system, JointTree)
    every = max(1, round(1 / (rate * found.setup.scenario.dt)))
    table, fingers = {"time": log.t[::every]}, _fingers(found)
    angles = np.unwrap(system.angles(log.q), axis=0)
    for k, (name, angle) in enumerate(zip(joint_names(found.setup), angles.T, strict=True)):
        if name in fingers:
            continue
        table[f"{name}_position"] = angle[::every]
        if velocities:
            table[f"{name}_velocity"] = log.v[::every, k]
        table[f"{name}_current"] = units[k] * log.u[::every, k]
    return table


def _vehicle_log(found: Simulated, folder: Path) -> Path:
    table = {"t": found.log.t}
    for name, part in zip("qvu", found.log[1:], strict=True):
        table |= {f"{name}_{k}": column for k, column in enumerate(part.T)}
    return _csv(folder / "log.csv", table)


def _csv(path: Path, table: dict[str, Array]) -> Path:
    columns = np.column_stack(list(table.values()))
    np.savetxt(path, columns, delimiter=",", header=",".join(table), comments="")
    return path


def judge(result: Identification, found: Simulated, units: Array) -> Judgement:
    """Judges the parameters that are called identified.

    Args:
        result: of `identify`.
        found: the simulated run; the truth is taken at its middle, as gains may fade.
        units: (n_u,) amperes per command: gains per ampere are those per command times this.
    """
    system, plant = found.setup.system, found.setup.plant
    truth = plant.truth_at(0.5 * float(found.log.t[-1])).copy()
    at = system.space.actuators
    if len(at) == len(units):
        truth[at] *= units
    names = set(system.space.names)
    if found.case.kind == "arm" and _fingers(found):  # they are part of the last link that moves
        names -= {name for b, _ in system.space for name in b.names if b.name.startswith("link")}
    said = Judgement(figures={"explains": result.explains, "anchor": result.anchor})
    ratios = "only in combination"  # a gain whose scale rests on the model file's masses
    if doubted(result):
        said.flagged.append(f"the verdict is {result.explains}")
    gains = [p for p in result.parameters if p.name in {system.space.names[i] for i in at}]
    if not any(p.status in ("identified", "known", ratios) for p in gains):
        said.unsure.append("no gain is identified")
    held, off = [], []
    for p in result.parameters:
        if p.status != "identified" or p.name not in names:
            continue
        true, size = float(truth[system.space.index(p.name)]), _size(system, truth, p.name)
        if not np.isfinite([p.value, p.low, p.high]).all():
            said.wrong.append(f"the interval of {p.name} is not a number")
            continue
        half = p.high - p.value if true > p.value else p.value - p.low
        held.append(p.low <= true <= p.high)
        if abs(p.value - true) > max(HALF_WIDTHS * half, LEAST * size):
            off.append(f"{p.name} {p.value:.3g} ({p.low:.3g} … {p.high:.3g}), truly {true:.3g}")
    said.coverage = float(np.mean(held)) if held else None
    said.wrong += off[:4] + ([f"and {len(off) - 4} more"] if len(off) > 4 else [])
    judge_ratios(said, gains, truth[[system.space.index(p.name) for p in gains]])
    return said


def doubted(result: Identification) -> bool:
    """Whether the verdict doubts more than the common scale, which nothing fixes in half the logs.

    Of those logs the ratios of the gains are judged.
    """
    residuals = any(f.code == "residuals" and f.level == "warning" for f in result.findings)
    return result.explains == "no" or residuals or verdict(result.joints)[0] != "yes"


def _size(system: Any, truth: Array, name: str) -> float:
    """What an error of a parameter is relative to: its true value.

    Of a body's first moments or inertia it is the largest of them, since single ones may be 0.
    """
    index = system.space.index(name)
    for block, rows in system.space:
        if rows.start <= index < rows.stop and block.geometry == "pseudo_inertia":
            like = [
                i
                for i in range(rows.start, rows.stop)
                if system.space.units[i] == system.space.units[index]
            ]
            return float(np.abs(truth[like]).max())
    return abs(float(truth[index]))


def judge_ratios(said: Judgement, gains: list[Any], truth: Array) -> None:
    """Judges the gains of identified actuators relative to each other."""
    use = [
        k
        for k, p in enumerate(gains)
        if p.relative is not None
        and (p.status == "identified" or (p.status == "only in combination" and p.relative < WIDE))
    ]
    if len(use) < 2:
        return
    half = np.array([gains[k].relative for k in use])
    error = np.log(np.array([gains[k].value for k in use]) / truth[use])
    error = error - np.average(error, weights=1 / np.maximum(half, 1e-6) ** 2)
    said.gain_errors, said.gain_deviations = error.tolist(), (half / 1.96).tolist()
    off = (np.abs(error) > HALF_WIDTHS * half) & (np.abs(error) > LEAST)
    if off.any():
        worst = int(np.argmax(np.abs(error) * off))
        said.wrong.append(
            f"{gains[use[worst]].name} off by {100 * error[worst]:.2g} % of the others, "
            f"stated to {100 * half[worst]:.2g} %"
        )
