"""Counts the modules of the package that a command imports, in all its processes, by package.

    python scripts/entered.py run ur5 --duration 1
    python scripts/entered.py --list identify tx40

Every module counts that is in `sys.modules` when a process ends; processes that the command starts
count, too, and a module that several of them import counts once.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

NOTE = "NSAID_ENTERED"
"""Environment variable with the folder in which every process notes its modules."""

_HOOK = f'''
import atexit, os, sys, tempfile

def note(folder=os.environ["{NOTE}"]):
    with tempfile.NamedTemporaryFile("w", dir=folder, delete=False) as file:
        file.write(" ".join(sys.modules))

atexit.register(note)
'''
"""Text of the `sitecustomize` that Python imports at the start of every process."""


def entered(arguments: Sequence[str], cwd: Path | None = None) -> tuple[int, set[str]]:
    """Executes `nsaid` with these arguments.

    Returns:
        Its exit code, and the names of all modules that it or a process of its imported.
    """
    with tempfile.TemporaryDirectory() as folder:
        hook, notes = Path(folder, "hook"), Path(folder, "notes")
        hook.mkdir()
        notes.mkdir()
        (hook / "sitecustomize.py").write_text(_HOOK, encoding="utf-8")
        root = Path(__file__).resolve().parent.parent
        paths = [str(hook), str(root), os.environ.get("PYTHONPATH", "")]
        environment = os.environ | {NOTE: str(notes), "PYTHONPATH": os.pathsep.join(paths)}
        command = "from nsaid_mj.cli import run_from_shell; run_from_shell()"
        words = [sys.executable, "-c", command, *arguments]
        done = subprocess.run(
            words,
            cwd=cwd,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            check=False,
        )
        texts = [path.read_text(encoding="utf-8") for path in notes.iterdir()]
    return done.returncode, {name for text in texts for name in text.split()}


def files(modules: set[str]) -> list[str]:
    """The names of the package's own modules, without its prefix; a script's is not among them."""
    prefix = "nsaid_mj."
    own = {name.removeprefix(prefix) for name in modules if name.startswith(prefix)}
    return sorted(own)


def main() -> None:
    """Prints the count, and how many modules are of which package."""
    arguments = sys.argv[1:]
    listed = "--list" in arguments[:1]
    if listed:
        arguments = arguments[1:]
    if not arguments:
        sys.exit(__doc__)
    code, modules = entered(arguments)
    own = files(modules)
    if listed:
        print("\n".join(own))
    packages = Counter(name.partition(".")[0] for name in own)
    counts = ", ".join(f"{name} {number}" for name, number in packages.most_common())
    print(f"{len(own)} modules: {counts} (exit code {code})")


if __name__ == "__main__":
    main()
