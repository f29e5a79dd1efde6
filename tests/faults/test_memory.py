"""What a run and its finishing leave in memory: nothing, however long or often."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.record import RECORD_FILE
from tests.support.faulty import ROV

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="counts threads and memory in /proc"
)


def task_count() -> int:
    return len(list(Path("/proc/self/task").iterdir()))


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


@pytest.mark.parametrize("times", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_finishing_leaves_no_threads_and_no_memory(times: int, tmp_path: Path) -> None:
    done = run(replace(ROV, duration=0.5, held_out=0.2, pe_window=0.2), tmp_path)
    for _ in range(2):
        postprocessing.finish(done)
    threads, memory = task_count(), resident()
    for _ in range(times):
        postprocessing.finish(done)
    assert task_count() <= threads
    assert resident() < memory + 20.0


FINISH = """
import sys, time
from pathlib import Path
from nsaid_mj.lab import postprocessing
begin = time.monotonic()
postprocessing.rebuild(Path(sys.argv[1]))
# the kernel's ru_maxrss begins with that of the process that started this one
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
print(int(status["VmHWM"].split()[0]) / 1000, time.monotonic() - begin)
"""


@pytest.mark.slow
def test_an_hour_at_500_hz_is_finished_in_a_minute_with_little_memory(tmp_path: Path) -> None:
    from nsaid_mj.lab.library import load

    run(replace(load("ur5"), dt=0.002, duration=3600.0), tmp_path)
    words = [sys.executable, "-c", FINISH, str(tmp_path)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    assert float(said[0]) < (tmp_path / RECORD_FILE).stat().st_size / 1e6 + 500
    assert float(said[1]) < 60.0


HOUR = """
import sys
from dataclasses import replace
from pathlib import Path
from nsaid_mj import run
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import Observer

class Watch(Observer):
    period, seen = 36.0, []
    def start(self, scenario, robot, first): pass
    def stop(self): pass
    def see(self, log, states, levels):
        self.seen.append(int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6)

scenario = load(sys.argv[1])
law = replace(scenario.identifier, law=sys.argv[2])
scenario = replace(scenario, identifier=law, rivals={}, duration=3600.0, record_every=1000)
watch = Watch()
run(scenario, Path(sys.argv[3]), watch)
print(len(watch.seen), *watch.seen)
"""


@pytest.mark.slow
@pytest.mark.parametrize("law", ["paper", "cone", "memory", "efficient"])
@pytest.mark.parametrize("name", ["ur5", "bluerov2", "uvms"])
def test_an_hour_of_simulated_time_keeps_memory_flat(name: str, law: str, tmp_path: Path) -> None:
    words = [sys.executable, "-c", HOUR, name, law, str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    count, *seen = map(float, done.stdout.split())
    assert count >= 100
    tenth = len(seen) // 10
    assert max(seen[tenth:]) < 1.02 * seen[tenth]
