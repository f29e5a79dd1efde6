"""CPU seconds of first commands, from an empty cache and from a warm one, as ratios to imports.

`python scripts/startup.py [NAME …]` prints one table. B is the CPU time of importing numba, MuJoCo,
Pinocchio and SciPy, measured around every command, because it varies by machine and minute. All
time counts: user and system, of the command and its children.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

IMPORTS = "import numba, mujoco, pinocchio, scipy.optimize"
NSAID = "from nsaid_mj.cli import run_from_shell; run_from_shell()"
COMMANDS = {
    "scalar_rov": ("run scalar_rov --duration 2", 6.0, 2.0),
    "ur5": ("run ur5 --law efficient --duration 3", 9.0, None),
    "tx40": ("identify tx40", 10.0, None),
}
"""Arguments of `nsaid`, and the largest accepted ratios to B, cold and warm."""


def spent(code: str, *arguments: str, **environment: str) -> float:
    """CPU seconds of a Python process and its children [s].

    Raises:
        SystemExit: the process fails; its messages are printed.
    """
    # as in an installed package, modules are compiled to bytecode once
    environment = {"PYTHONDONTWRITEBYTECODE": ""} | environment
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 1):  # 1: the verdict is that a run is not explained
        sys.exit(f"{arguments}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(command: str) -> tuple[float, float, float]:
    """B, and CPU seconds of a command with an empty and with a warm cache [s]."""
    with tempfile.TemporaryDirectory() as folder:
        cache = {"NUMBA_CACHE_DIR": str(Path(folder) / "cache")}
        imports = [spent(IMPORTS)]
        times = []
        for name in ("cold", "warm"):
            out = str(Path(folder) / name)
            times.append(spent(NSAID, *command.split(), "--out", out, **cache))
        imports.append(spent(IMPORTS))
    return sum(imports) / 2, times[0], times[1]


def main() -> None:
    """Prints the table of the commands that are named, or of all."""
    spent(IMPORTS)  # so that all of it has been read from the disk once
    print("| command | B [s] | cold [s] | cold / B (bar) | warm [s] | warm / B (bar) |")
    print("|---|---|---|---|---|---|")
    for name in sys.argv[1:] or COMMANDS:
        command, bar, warm_bar = COMMANDS[name]
        base, cold, warm = measured(command)
        ratios = f"{cold / base:.1f} ({bar:g}) | {warm:.1f} | {warm / base:.1f}"
        print(f"| `nsaid {command}` | {base:.2f} | {cold:.1f} | {ratios}", end="")
        print(f" ({warm_bar:g}) |" if warm_bar else " |", flush=True)


if __name__ == "__main__":
    main()
