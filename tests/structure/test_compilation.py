"""Kernels are compiled in one step, once; later processes load them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from nsaid_mj.structure.compilation import ready
from nsaid_mj.structure.compiled import MARKED, Kernel

COUNT = """
from numba.core import event  # the Event API is in numba's manual
class Counter(event.Listener):
    count = 0
    def on_start(self, _): self.count += 1
    def on_end(self, _): pass
counter = Counter()
event.register("numba:compile", counter)
from nsaid_mj.structure.compilation import ready
from nsaid_mj.structure.structure import Structure
import nsaid_mj.identifiers, nsaid_mj.systems.compiled, nsaid_mj.dynamics.motions
assert counter.count == 0, "importing compiles"
ready()
assert counter.count == {expected}, counter.count
"""


def run(expected: int) -> None:
    code = COUNT.format(expected=expected)
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300, cwd=root)


def test_every_kernel_has_one_specialisation_and_is_found_on_disk():
    """Functions that kernels call may have more here: tests call some of them from Python."""
    ready()
    assert {len(k.function.signatures) for k in MARKED if isinstance(k, Kernel)} == {1}
    run(0)
