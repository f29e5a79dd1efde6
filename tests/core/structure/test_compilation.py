"""Kernels are compiled once, and called by their address; later processes load them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit

from nsaid_mj.core.numerics.kernels import FAST, f8, kernel, vector
from nsaid_mj.lab.plants.world.stepping import track

COUNT = """
from numba.core import event  # the Event API is in numba's manual
class Counter(event.Listener):
    count = 0
    def on_start(self, _): self.count += 1
    def on_end(self, _): pass
counter = Counter()
event.register("numba:compile", counter)
import nsaid_mj.core.structure.joints, nsaid_mj.core.structure.motion
from nsaid_mj.core.laws.efficient.kalman import _follow
from nsaid_mj.lab.plants.world.stepping import track
assert counter.count == 0, "importing compiles"
_follow.load()
track.load()
assert counter.count == 0, counter.count
"""


@kernel(f8(vector), inner=True)
def norm(x):
    """A kernel."""
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * x[i]
    return np.sqrt(total)


@kernel(f8(vector))
def twice(x):
    """A kernel that calls another one."""
    return 2.0 * norm(x)


def test_importing_compiles_nothing_and_a_second_process_finds_all_kernels():
    from nsaid_mj.core.laws.efficient.kalman import _follow

    _follow.load()
    track.load()
    root = Path(__file__).parents[3]
    subprocess.run([sys.executable, "-c", COUNT], check=True, timeout=300, cwd=root)


def test_a_kernel_called_by_address_gives_the_same_numbers_and_has_no_text_in_the_caller():
    x = np.random.default_rng(0).standard_normal(5)
    assert twice(x) == 2.0 * norm(x) == 2.0 * norm.py_func(x)
    made: Any = njit(**FAST)(twice.py_func)  # text loaded from the cache cannot be inspected
    made.compile(f8(vector))
    (text,) = made.inspect_llvm().values()
    about = [line for line in text.splitlines() if norm.symbol in line]
    assert any(line.startswith("declare") for line in about)
    assert not any(line.startswith("define") for line in about)
    assert "sqrt" not in text


def test_a_kernel_refuses_other_types():
    with pytest.raises(TypeError, match="No matching definition"):
        twice(np.zeros(3, dtype=np.float32))
    with pytest.raises(TypeError, match="No matching definition"):
        twice(np.zeros((3, 3)))
