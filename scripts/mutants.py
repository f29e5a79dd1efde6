"""Whether tests notice a wrong line: mutants of the code, one at a time, in a copy of the tree.

    python -m scripts.mutants [calibration …] [--only WORDS]
    python -m scripts.mutants --draw 40 --seed 1 [lab clinic/identify …]

`scripts/mutants/ROOM.toml` has one line for each mutant of a room: the file, a text that occurs
once in it, what replaces it, the tests that should fail, why it matters, and, for one that may
survive, why that does not matter. Every named test must pass before anything is changed. Prints
killed and survived, and ends with 1 if fewer than nine in ten are killed.

With `--draw` faults of one line are drawn instead, from all houses and rooms alike or from those
named (`scripts/drawn.py`). The tests that call the function must notice, as far as they take
25 s: those of its place first, then the cheapest of every other file. `python -m scripts.called`
finds out once which tests call it. A test that fails counts only if it passes without the fault;
tests that take more than `LONGEST` leave it undecided. Lines that only word a message, and faults
that change no result, are among what is drawn: read the survivors.

Kernels are compiled in a cache of the copy's own. Of a drawn fault in a kernel's source, only the
kernels that have the wrong text are compiled again. Those of a room that is `interpreted` run as
plain Python.
"""

from __future__ import annotations

import argparse
import importlib
import json
import lzma
import os
import pkgutil
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter, defaultdict
from pathlib import Path
from typing import NamedTuple

import nsaid_mj
from nsaid_mj.core.numerics import cache, shipped
from nsaid_mj.core.numerics.kernels import KERNELS, Kernel
from scripts import called
from scripts.drawn import Fault, drawn, nearest, rooms

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "scripts" / "mutants"
KILLED = 0.9  # least share
LONGEST = 120  # processor time in which the tests of a fault must end [s]
TREES = ("nsaid_mj", "tests", "scripts", "assets", "scenarios", "docs", "examples")


class Mutant(NamedTuple):
    """One wrong line.

    Attributes:
        file: that is changed, from the root.
        old: text that occurs once in it.
        new: what replaces it.
        tests: that should fail, from the root.
        why: what would be wrong.
        excuse: why its survival does not matter; "" if it must be killed.
        interpreted: whether its tests run kernels as plain Python, without compiling.
    """

    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    why: str
    excuse: str = ""
    interpreted: bool = False


def mutants_of(room: str) -> list[Mutant]:
    """The mutants of `scripts/mutants/ROOM.toml`.

    Raises:
        SystemExit: a text does not occur exactly once.
    """
    with (FOLDER / f"{room}.toml").open("rb") as file:
        data = tomllib.load(file)
    found = []
    for name, old, new, tests, *words in data["mutants"]:
        count = (ROOT / data["code"] / name).read_text(encoding="utf-8").count(old)
        if count != 1:
            raise SystemExit(f"{name}: {old!r} occurs {count} times")
        paths = tuple(f"{data['tests']}/{test}" for test in tests.split())
        mutant = Mutant(f"{data['code']}/{name}", old, new, paths, *words)
        found.append(mutant._replace(interpreted=data.get("interpreted", False)))
    return found


def copied(folder: Path) -> None:
    """Copies the tree with its caches, whose stamps are those of the files."""
    for name in TREES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, symlinks=True)
    for file in (*ROOT.glob("*.toml"), *ROOT.glob("*.md")):
        shutil.copy2(file, folder / file.name)
    shutil.copytree(cache.FOLDER, folder / "kernels" / "nsaid-mj" / cache.FOLDER.name)


def passes(folder: Path, tests: tuple[str, ...], interpreted: bool = False) -> bool:
    """Whether tests pass in a copy of the tree, with kernels compiled or as plain Python.

    Raises:
        SystemExit: they cannot be run at all.
        TimeoutError: they take too long.
    """
    return not failed(folder, tests, interpreted)


def failed(folder: Path, tests: tuple[str, ...], interpreted: bool = False) -> str:
    """The first test that fails in a copy of the tree, or the whole output if none can be run.

    Raises:
        SystemExit: pytest ends otherwise.
        TimeoutError: they take too long.
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rfE", "-p", "no:cacheprovider"]
    command += ["-n", "0", "-m", "not slow", *tests]
    own = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "kernels")}
    own |= {"NUMBA_DISABLE_JIT": "1"} if interpreted else {}
    own |= {"OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "", "COLUMNS": "1000"}
    try:
        done = subprocess.run(
            command,
            check=False,
            cwd=folder,
            env=os.environ | own,
            capture_output=True,
            text=True,
            timeout=10 * LONGEST,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST)),
        )
    except subprocess.TimeoutExpired as error:
        raise TimeoutError from error
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        raise TimeoutError
    if done.returncode not in (0, 1, 2, 4):  # 2, 4: a file cannot be imported
        raise SystemExit(f"{' '.join(tests)}: {done.stdout[-500:]}{done.stderr[-500:]}")
    if not done.returncode:
        return ""
    words = done.stdout
    marked = [test for test in tests if f"FAILED {test}" in words or f"ERROR {test}" in words]
    return max(marked, key=len, default=done.stdout + done.stderr)


def survives(folder: Path, mutant: Mutant) -> bool:
    """Whether the tests of a mutant pass although it is in the tree."""
    path = folder / mutant.file
    text, stamp = path.read_text(encoding="utf-8"), path.stat()
    try:
        path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
        return passes(folder, mutant.tests, mutant.interpreted)
    finally:
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))


def draw(folder: Path, names: list[str], count: int, seed: int) -> int:
    """Draws `count` faults, runs their nearest tests in a copy of the tree, prints what became."""
    rng = random.Random(seed)
    calls = called.known()
    if not calls.functions:
        raise SystemExit("Run `python -m scripts.called` first: which tests call which functions?")
    chosen = {
        room: files
        for room, files in rooms().items()
        if not names or any(f"{room}/".startswith(f"{name.rstrip('/')}/") for name in names)
    }
    kernels = Kernels(folder)
    fates: dict[str, Counter[str]] = defaultdict(Counter)
    for _ in range(count):
        room = rng.choice(sorted(chosen))
        fault = drawn(chosen[room], rng)
        tests = nearest(fault, calls)
        begin = time.monotonic()
        fate, by = (
            _fate(folder, fault, tests, kernels) if tests else ("SURVIVED", "no test calls it")
        )
        fates[fault.file.split("/")[1]][fate] += 1
        place = f"{fault.file}:{fault.line} ({fault.function})"
        print(f"{fate} {place}: {fault.before}  →  {fault.after}")
        print(f"    {by or f'{len(tests)} tests'}, {time.monotonic() - begin:.0f} s", flush=True)
    total: Counter[str] = Counter()
    for house, of_house in sorted(fates.items()):
        total += of_house
        print(f"{house:8}", *(f"{number} {fate}" for fate, number in sorted(of_house.items())))
    share = total["killed"] / max(total["killed"] + total["SURVIVED"], 1)
    print(f"{total['killed']} killed ({share:.0%}) of {count}, {total['undecided']} undecided")
    return int(share < KILLED)


def _fate(folder: Path, fault: Fault, tests: tuple[str, ...], kernels: Kernels) -> tuple[str, str]:
    """What becomes of a fault, and the test that notices it."""
    path = folder / fault.file
    text = path.read_bytes()
    try:
        path.write_text(fault.text, encoding="utf-8")
        kernels.prepare(fault)
        test = failed(folder, tests)
    except TimeoutError:
        return "undecided", ""
    finally:
        path.write_bytes(text)
        kernels.restore()
    if test in tests and not passes(folder, (test,)):
        return "undecided", f"{test} fails without the fault"
    return ("killed", test if test in tests else "not importable") if test else ("SURVIVED", "")


class Kernels:
    """The kernels of a copy of the tree, of which few are compiled again for a fault in a source.

    The package's own code of kernels and numba's cache are valid for the sources as they are. For
    those with a fault, both are used without the kernels that are made from the wrong text.
    """

    def __init__(self, folder: Path):
        self._package = folder / "nsaid_mj"
        self._home = folder / "kernels" / "nsaid-mj"
        self._shipped = self._package / shipped.path().relative_to(ROOT / "nsaid_mj")
        self._before = self._shipped.read_bytes()
        self._sound = self._home / cache.digest(self._package)
        for module in pkgutil.walk_packages(nsaid_mj.__path__, "nsaid_mj."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)

    def prepare(self, fault: Fault) -> None:
        """Once the copy has a fault: the kernels without it need not be compiled again."""
        digest = cache.digest(self._package)
        if digest == self._sound.name:
            return
        wrong = {name for name, kernel in KERNELS.items() if _has(kernel, fault)}
        content = json.loads(lzma.decompress(self._before))
        content["origin"][0] = cache.sources_digest(self._package)
        for symbol in wrong:
            content["kernels"].pop(symbol, None)
        self._shipped.write_bytes(lzma.compress(json.dumps(content).encode(), preset=0))
        if self._sound.is_dir():
            shutil.copytree(self._sound, self._home / digest)
        for path in (self._home / digest).rglob("*"):
            if path.name.removesuffix(".o") in wrong or (
                path.suffix in (".nbi", ".nbc") and not path.name.startswith("kernels.nsaid_mj_")
            ):
                path.unlink()

    def restore(self) -> None:
        """The kernels of the sound tree again."""
        self._shipped.write_bytes(self._before)
        for path in self._home.glob("*"):
            if path != self._sound:
                shutil.rmtree(path)


def _has(kernel: Kernel, fault: Fault) -> bool:
    """Whether a kernel's own code is made from a text with a fault, or with what it sets."""
    own = called.compiled_into(kernel, called=False)
    if f"{fault.file.removeprefix('nsaid_mj/')}:{fault.function}" in own:
        return True
    return any(name in fault.assigned for name in kernel.py_func.__code__.co_names)


def main() -> int:
    """Runs the mutants and prints what became of them."""
    rooms = sorted(path.stem for path in (ROOT / "scripts/mutants").glob("*.toml"))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rooms", nargs="*")
    parser.add_argument("--only", default="", help="words that the file or the reason has")
    parser.add_argument("--draw", type=int, default=0, help="number of faults to draw")
    parser.add_argument("--seed", type=int, default=0, help="of the faults that are drawn")
    arguments = parser.parse_args()
    if arguments.draw:
        with tempfile.TemporaryDirectory() as name:
            copied(Path(name))
            return draw(Path(name), arguments.rooms, arguments.draw, arguments.seed)
    mutants = [m for room in arguments.rooms or rooms for m in mutants_of(room)]
    mutants = [m for m in mutants if arguments.only in f"{m.file} {m.why}"]
    alive = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copied(folder)
        for interpreted in sorted({mutant.interpreted for mutant in mutants}):
            ours = (m.tests for m in mutants if m.interpreted is interpreted)
            tests = tuple(sorted({test for each in ours for test in each}))
            if not passes(folder, tests, interpreted):
                raise SystemExit("The tests fail without any mutant.")
        for mutant in mutants:
            left = survives(folder, mutant)
            alive += [mutant] if left else []
            print(f"{'SURVIVED' if left else 'killed  '} {mutant.file}: {mutant.why}", flush=True)
    share = 1 - len(alive) / max(len(mutants), 1)
    print(f"{len(mutants) - len(alive)} of {len(mutants)} killed ({share:.0%})")
    for mutant in alive:
        print(f"  {mutant.why}: {mutant.excuse or 'should have been killed'}")
    return int(share < KILLED or any(not mutant.excuse for mutant in alive))


if __name__ == "__main__":
    sys.exit(main())
