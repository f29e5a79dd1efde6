"""Makes examples/*.ipynb from examples/*.py and runs them.

    python scripts/notebooks.py            # with output, as they are committed
    python scripts/notebooks.py --check    # fails if a notebook is not made from its script

The scripts are the source; edit those.
"""

import argparse
import sys
from pathlib import Path

import jupytext
from nbclient import NotebookClient

EXAMPLES = Path(__file__).parents[1] / "examples"


def cells(notebook: object) -> list[tuple[str, str]]:
    """Kind and text of every cell."""
    return [(cell["cell_type"], cell["source"]) for cell in notebook["cells"]]  # type: ignore[index]  # a NotebookNode


def main() -> None:
    """Makes the notebooks, or checks them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("names", nargs="*", help="of examples; all if left out")
    arguments, stale = parser.parse_args(), []
    check = arguments.check
    for script in sorted(EXAMPLES.glob("*.py")):
        if arguments.names and script.stem not in arguments.names:
            continue
        made, path = jupytext.read(script), script.with_suffix(".ipynb")
        if check:
            if not path.is_file() or cells(jupytext.read(path)) != cells(made):
                stale.append(path.name)
            continue
        home = {"metadata": {"path": str(EXAMPLES)}}
        NotebookClient(made, timeout=1200, resources=home).execute()
        for number, cell in enumerate(made["cells"]):  # the same file from the same results
            cell["id"] = f"{script.stem}-{number}"
            cell["metadata"].pop("execution", None)
        jupytext.write(made, path)
    if stale:
        sys.exit(f"not made from their scripts: {', '.join(stale)}; run scripts/notebooks.py")


if __name__ == "__main__":
    main()
