"""Drawing in a child process gives the same bytes, even if the child dies."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from nsaid_mj.reporting.drawer import Drawer
from nsaid_mj.reporting.panels import Panel
from nsaid_mj.reporting.plots import over_time


def panels() -> list[Panel]:
    made = []
    for logarithmic in (False, True):
        panel = Panel("what", "y [m]", logarithmic, level=1.0)
        panel.add(np.linspace(0, 1, 50), np.r_[np.nan, np.geomspace(0.1, 3, 49)], "one")
        panel.add(np.linspace(0, 1, 50), np.r_[np.inf, np.full(49, 1 / 3)], "other")
        made.append(panel)
    return made


@pytest.fixture
def unloaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if matplotlib were not loaded yet: then a child is started."""
    monkeypatch.delitem(sys.modules, "matplotlib.figure")


def test_the_child_process_draws_the_same_bytes(
    unloaded: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Drawer() as drawer:
        child = drawer._child
        assert child is not None
        drawn = drawer._ask(panels())
    assert drawn == [over_time(panel) for panel in panels()]
    assert child.returncode == 0


def test_without_its_child_this_process_draws(unloaded: None) -> None:
    with Drawer() as drawer:
        assert drawer._child is not None
        drawer._child.kill()
        assert drawer.draw(panels()) == [over_time(panel) for panel in panels()]


def test_a_child_that_is_not_needed_ends_with_the_context(unloaded: None) -> None:
    with Drawer() as drawer:
        child = drawer._child
        assert child is not None
        assert child.poll() is None
    assert child.returncode is not None


def test_no_child_is_started_where_matplotlib_is_loaded() -> None:
    with Drawer() as drawer:
        assert drawer._child is None
        assert drawer.draw(panels()) == [over_time(panel) for panel in panels()]


def test_a_run_never_loads_matplotlib_in_its_own_process() -> None:
    code = (
        "import sys, numpy as np\nfrom nsaid_mj.reporting.drawer import Drawer\n"
        "from nsaid_mj.reporting.panels import Panel\n"
        "p = Panel('what', 'y [m]')\np.add(np.arange(3.0), np.arange(3.0))\n"
        "with Drawer() as drawer: print(drawer.draw([p])[0][:4], 'matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "<svg False"
