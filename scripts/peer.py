"""The peer, `mujoco.sysid`, beside `identified` on logs of a servo arm: a table of docs/results.md.

    python scripts/peer.py FOLDER   # with so101.xml, logs NAME.csv.gz, and other.xml, see
                                    # scripts/published.py

Every method fits each half of the logs and predicts the other, from the values of two files. Its
options are described in nsaid_mj/calibration/servos/sysid.py.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from nsaid_mj.calibration.comparison import FITTED, compare_servos
from nsaid_mj.calibration.servos import identify_servos, servo_logs


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    print("| model | from | 0.2 s [mrad] | 2 s | log | one step, NRMSE | CPU s |")
    print("|---|---|---|---|---|---|---|")
    for name in ("so101.xml", "other.xml"):
        given = servo_logs(folder / name, sorted(folder.glob("*.csv.gz")))
        assert given is not None
        identify_servos(given._replace(logs=given.logs[:1]))  # compiles
        for model in (folder / name, *FITTED):
            score, target = compare_servos(given, [model])
            errors = " | ".join(f"{1e3 * x:.1f}" for x in score.errors.mean(axis=1))
            print(
                f"| {Path(score.model).name} | {name} | {errors} | {score.one_step.mean():.2f} | "
                f"{score.seconds:.0f} |",
                flush=True,
            )
    print(f"| {target.model} | | – | – | {1e3 * target.errors[-1].mean():.1f} | – | |")


if __name__ == "__main__":
    main()
