"""The command line: `nsaid list`, `run`, `sweep` …; `main` for scenario scripts."""

from .commands import main as main
from .commands import run_from_shell as run_from_shell
