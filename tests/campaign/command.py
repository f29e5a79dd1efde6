"""The command: carries out the tries, prints failures and the table."""

import argparse

from . import FAMILIES, carry_out


def main(description: str) -> int:
    """Runs the families; returns the exit code."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("families", nargs="*", help=", ".join(FAMILIES))
    parser.add_argument("--tries", type=int, default=100, help="of each family")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    table = []
    for family in chosen.families or FAMILIES:
        tried = failed = 0
        for found in carry_out(family, chosen.tries, chosen.seed):
            tried, failed = tried + 1, failed + bool(found.wrong)
            if found.wrong:
                words = f"{family}: {found.name}\n    {found.wrong}"
                print(words.encode("utf-8", "replace").decode(), flush=True)
        table.append((family, tried, failed))
        print(f"-- {family}: {failed} of {tried} failed", flush=True)
    print("| family | tried | failed |\n|---|---|---|")
    for row in [*table, ("all", sum(t for _, t, _ in table), sum(f for *_, f in table))]:
        print("| {} | {} | {} |".format(*row))
    return int(any(failed for *_, failed in table))
