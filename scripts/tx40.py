"""How well `nsaid identify` predicts a real arm's log that it has not seen.

    python scripts/tx40.py

Three fifths of the moving part of the Stäubli TX40's log (last, first, middle) are held out in
turn. Prints the NRMSE of every joint, and its ratio to weighted least squares on the same rows.
"""

from __future__ import annotations

import numpy as np

from nsaid_mj.calibration.arms import structured_arm
from nsaid_mj.calibration.calibrate import tempered_fit
from nsaid_mj.calibration.fit import minimise
from nsaid_mj.calibration.least_squares import least_squares
from nsaid_mj.calibration.logs import prepare, read_map, read_tables
from nsaid_mj.calibration.models import load_robot_model
from nsaid_mj.calibration.precision import tempered
from nsaid_mj.calibration.problem import without
from nsaid_mj.calibration.structure import Options
from nsaid_mj.resources import asset


def main() -> None:
    """Prints the table."""
    robot, mapping = load_robot_model("tx40"), read_map(asset("tx40", "map.toml"))
    recordings = prepare(read_tables([asset("tx40", "log.csv.gz")], mapping), mapping, robot)
    made = structured_arm(robot, recordings, None, Options(coupled=((4, 5),)), lambda _: None)
    problem, at = made.problem, made.problem.space.actuators
    _, share = tempered_fit(problem)
    N, ratios = len(problem.t), []
    parts = {
        "last": np.arange(4 * N // 5, N),
        "first": np.arange(N // 5),
        "middle": np.arange(2 * N // 5, 3 * N // 5),
    }
    for name, part in parts.items():
        rest, own = without(problem, part), problem.select(part)
        theta = minimise(rest, tempered(rest, share)).theta
        ours, plain = own.nrmse(theta), own.nrmse(least_squares(rest, theta[at]))
        ratios += (ours / plain).tolist()
        print(f"{name:6} NRMSE {np.round(ours, 3)}, over least squares {np.round(ours / plain, 2)}")
    below = np.sum(np.array(ratios) <= 1.05)
    print(f"{below} of {len(ratios)} at most 1.05, the worst {max(ratios):.2f}")


if __name__ == "__main__":
    main()
