"""The command line `nsaid`, and `main` for scenario scripts."""

from .commands import main as main
from .commands import run_from_shell as run_from_shell
