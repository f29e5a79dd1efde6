"""`make store-directions`: stores the directions that the scenarios now converge to.

Give names to store only those: `python -m tests.recovery.store ur5 panda`.
"""

import sys
import tempfile
from pathlib import Path

from tests.recovery import direction


def main(names: list[str]) -> None:
    """Runs the scenarios, prints names, old and new values, stores the new ones."""
    for name in names or direction.names():
        with tempfile.TemporaryDirectory() as folder:
            _, new = direction.converge(name, Path(folder))
        moved = direction.changes(direction.stored(name), new)
        print(f"{name}: {len(moved)} of {len(new)} entries moved")
        for line in moved:
            print(f"  {line}")
        if moved:
            direction.store(name, new)


if __name__ == "__main__":
    main(sys.argv[1:])
