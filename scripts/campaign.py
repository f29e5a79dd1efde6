"""The fault campaign: tries of many kinds, each of which must end well or in a typed error.

    python -m scripts.campaign [FAMILY …] [--tries 100] [--seed 0]

Prints the tries that failed, and a table of tried and failed per family. The families are those of
the modules `campaign_*`, each a function `carry_out(family, tries, seed)` and a table `FAMILIES`.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

TYPED = ("ok", "typed")


def modules() -> Iterator[Any]:
    """The modules that have families."""
    for path in sorted(Path(__file__).parent.glob("campaign_*.py")):
        module = importlib.import_module(f"scripts.{path.stem}")
        if hasattr(module, "FAMILIES"):
            yield module


def main() -> int:
    """Prints failures and the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("families", nargs="*")
    parser.add_argument("--tries", type=int, default=100, help="of each family")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    homes = {family: module for module in modules() for family in module.FAMILIES}
    table = []
    for family in chosen.families or homes:
        tried = failed = 0
        for found in homes[family].carry_out(family, chosen.tries, chosen.seed):
            tried += 1
            if found.outcome not in TYPED:
                failed += 1
                words = f"{family}: {found.outcome}: {found.name}\n    {found.words}"
                print(words.encode("utf-8", "replace").decode(), flush=True)
        table.append((family, tried, failed))
        print(f"-- {family}: {failed} of {tried} failed", flush=True)
    print("| family | tried | failed |\n|---|---|---|")
    for row in [*table, ("all", sum(t for _, t, _ in table), sum(f for *_, f in table))]:
        print("| {} | {} | {} |".format(*row))
    return int(any(failed for *_, failed in table))


if __name__ == "__main__":
    sys.exit(main())
