"""Which functions of the package each test calls, and what the test costs.

    python -m scripts.called [tests/core …]

Runs tests, all or those named, in one process with a profiler, which takes a third more time, and
writes `build/called.json`; what it has of other tests remains. `scripts/mutants.py` chooses by it
the tests that should notice a wrong line. What other processes call is not seen.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import pytest

from nsaid_mj.core.numerics.kernels import Kernel, named

ROOT = Path(__file__).parents[1]
FILE = ROOT / "build" / "called.json"
_PACKAGE = f"{ROOT / 'nsaid_mj'}/"


class Calls(NamedTuple):
    """What is known of tests that passed.

    Attributes:
        functions: tests that call a function, by `file:name` from the package's folder.
        seconds: processor time of every test, without what it shares [s].
        shared: fixtures that a test shares with others.
        fixtures: processor time of every shared fixture [s].
    """

    functions: dict[str, list[str]]
    seconds: dict[str, float]
    shared: dict[str, list[str]]
    fixtures: dict[str, float]


def known() -> Calls:
    """What `build/called.json` has; nothing if there is no such file."""
    if not FILE.is_file():
        return Calls({}, {}, {}, {})
    return Calls(**json.loads(FILE.read_text("utf-8")))


def name_of(code: CodeType) -> str:
    """The name of a function of the package; "" for others."""
    if not code.co_filename.startswith(_PACKAGE):
        return ""
    return f"{code.co_filename.removeprefix(_PACKAGE)}:{code.co_qualname}"


def compiled_into(kernel: Any, called: bool = True) -> set[str]:
    """The functions whose text a kernel is compiled from, and of kernels that it calls if asked."""
    found: set[str] = set()
    left = [kernel]
    while left:
        function = left.pop().py_func
        if name_of(function.__code__) in found:
            continue
        found.add(name_of(function.__code__))
        for value in named(function):
            apart = isinstance(value, Kernel) and value.signature is not None
            if hasattr(value, "py_func") and (called or not apart):
                left.append(value)
    return found


class Recorder:
    """A plugin of pytest that notes calls and processor time."""

    def __init__(self) -> None:
        self._called: set[Any] = set()
        self._names: dict[Any, set[str]] = {}
        self._of_fixture: dict[str, set[str]] = {}
        self._test = ""
        self._of_test: dict[str, set[str]] = defaultdict(set)
        self._seconds: dict[str, float] = defaultdict(float)
        self._shared: dict[str, list[str]] = {}
        self._fixtures: dict[str, float] = {}
        self._failed: set[str] = set()

    def _note(self, frame: Any, event: str, argument: Any) -> None:
        if event == "call":
            code = frame.f_code
            self._called.add(code)
            if code is Kernel.__call__.__code__:
                self._called.add(frame.f_locals["self"])

    def _take(self) -> set[str]:
        """Functions called since this was asked for last."""
        called, self._called = self._called, set()  # this function is noted, too
        for one in called - self._names.keys():
            names = compiled_into(one) if isinstance(one, Kernel) else {name_of(one)}
            self._names[one] = names - {""}
        return {
            name for one in called for name in self._names[one] if not name.endswith(":<module>")
        }

    def pytest_sessionstart(self) -> None:
        """From now on calls are noted."""
        sys.setprofile(self._note)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Notes what a test calls and takes."""
        self._take()
        self._test = item.nodeid
        before = _processor_time()
        result = yield
        self._seconds[item.nodeid] += _processor_time() - before
        keys = [f"{item.path.name}:{name}" for name in getattr(item, "fixturenames", ())]
        self._shared[item.nodeid] = [key for key in keys if key in self._of_fixture]
        of_fixtures = (self._of_fixture[key] for key in self._shared[item.nodeid])
        self._of_test[item.nodeid] |= self._take().union(*of_fixtures)
        return result

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Generator[None, Any, Any]:
        """Notes what a fixture calls and takes that tests share."""
        self._of_test[self._test] |= self._take()
        before = _processor_time()
        result = yield
        taken = self._take()
        self._of_test[self._test] |= taken
        if fixturedef.scope != "function" and fixturedef.argname != "drawings":
            key = f"{request.node.path.name}:{fixturedef.argname}"
            spent = _processor_time() - before
            self._of_fixture[key] = taken
            self._fixtures[key] = spent
            self._seconds[self._test] -= spent
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Notes which tests do not pass."""
        if report.failed or report.skipped:
            self._failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        """Writes what was noted, over what was known of the same tests."""
        sys.setprofile(None)
        functions, seconds, shared, fixtures = known()
        again = self._of_test.keys()
        by_function = defaultdict(list)
        for name, tests in functions.items():
            by_function[name] += [test for test in tests if test not in again]
        for test in again - self._failed:
            for name in self._of_test[test]:
                by_function[name].append(test)
        calls = Calls(
            {name: sorted(tests) for name, tests in sorted(by_function.items()) if tests},
            seconds | {test: round(spent, 3) for test, spent in self._seconds.items()},
            shared | self._shared,
            fixtures | self._fixtures,
        )
        FILE.parent.mkdir(exist_ok=True)
        FILE.write_text(json.dumps(calls._asdict()), "utf-8")


def _processor_time() -> float:
    """That of this process and of children that have ended [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def main(names: Iterable[str]) -> int:
    """Runs tests and notes what they call."""
    options = ["-q", "-p", "no:cacheprovider", "-n", "0", "-m", "not slow"]
    return pytest.main([*options, *names], plugins=[Recorder()])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
