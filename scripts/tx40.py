"""How well `nsaid identify` predicts a real arm's log that it has not seen.

    python scripts/tx40.py

Three fifths of the moving part of the Stäubli TX40's log (last, first, middle) are held out in
turn. Prints the NRMSE of every joint, and its ratio to weighted least squares on the same rows.
Then the published essential parameters with the gears given, and the gains where they are free.
"""

from __future__ import annotations

import csv
import re

import numpy as np

from nsaid_mj.calibration.arms import structured_arm
from nsaid_mj.calibration.calibrate import tempered_fit
from nsaid_mj.calibration.fit import minimise
from nsaid_mj.calibration.identify import identify
from nsaid_mj.calibration.least_squares import least_squares
from nsaid_mj.calibration.logs import prepare, read_map, read_tables
from nsaid_mj.calibration.models import load_robot_model
from nsaid_mj.calibration.precision import tempered
from nsaid_mj.calibration.structure import Options
from nsaid_mj.resources import asset

OURS = {
    "mx": "hx", "my": "hy", "mz": "hz", "Ia": "rotor", "fv": "viscous", "fs": "coulomb",
    "fvm": "coupling_viscous_5", "fsm": "coupling_coulomb_5",
}  # fmt: skip
"""Our names of the published parameters, where they differ."""


def essential() -> dict[str, tuple[float, float, bool]]:
    """Published essential parameters, ours, and whether they agree, with the gears given.

    Both are taken over viscous friction of joint 1 and shown at its published value. They agree
    within three published deviations or 10 %, whichever is larger.
    """
    known = {f"gain_{i}": 1.0 for i in range(1, 7)}
    found = identify("tx40", known=known, columns=["viscous"], delay=0.0)
    values = {p.name: p.value for p in found.parameters}

    def combination(words: str) -> float:
        terms = re.findall(r"(-?)(?:([\d.]+)\*)?([A-Za-z]+)(\d)", words.replace("- ", "-"))
        return sum(
            (-1 if sign else 1) * float(weight or 1) * values[f"{OURS.get(kind, kind)}_{joint}"]
            for sign, weight, kind, joint in terms
        )

    with asset("tx40", "published_essential_parameters.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.reader(file) if row]
    viscous = next(float(row[3]) for row in rows if row[0] == "fv1")
    table = {}
    for words, _, _, weighted, percent in rows:
        published, own = float(weighted), combination(words) * viscous / values["viscous_1"]
        near = max(0.03 * float(percent), 0.1) * abs(published)
        table[words] = published, own, abs(own - published) <= near
    return table


def main() -> None:
    """Prints the tables."""
    robot, mapping = load_robot_model("tx40"), read_map(asset("tx40", "map.toml"))
    recordings = prepare(read_tables([asset("tx40", "log.csv.gz")], mapping), mapping, robot)
    made = structured_arm(robot, recordings, None, Options(coupled=((4, 5, 1),)), lambda _: None)
    problem, at = made.problem, made.problem.space.actuators
    _, share = tempered_fit(problem)
    N, ratios = len(problem.t), []
    parts = {
        "last": np.arange(4 * N // 5, N),
        "first": np.arange(N // 5),
        "middle": np.arange(2 * N // 5, 3 * N // 5),
    }
    for name, part in parts.items():
        rest, own = (problem.select(rows) for rows in (np.delete(np.arange(N), part), part))
        theta = minimise(rest, tempered(rest, share)).theta
        ours, plain = own.nrmse(theta), own.nrmse(least_squares(rest, theta[at]))
        ratios += (ours / plain).tolist()
        print(f"{name:6} NRMSE {np.round(ours, 3)}, over least squares {np.round(ours / plain, 2)}")
    below = np.sum(np.array(ratios) <= 1.05)
    print(f"{below} of {len(ratios)} at most 1.05, the worst {max(ratios):.2f}")

    table = essential()
    for words, (published, own, agrees) in table.items():
        print(
            f"{words[:40]:40} published {published:8.4f} ours {own:8.4f} {'' if agrees else 'off'}"
        )
    print(f"{sum(agrees for *_, agrees in table.values())} of {len(table)} agree")
    for gain in identify("tx40").of("motor gain"):
        print(f"{gain.label}: {gain.value:.3f} [{gain.low:.2f}, {gain.high:.2f}] {gain.status}")


if __name__ == "__main__":
    main()
