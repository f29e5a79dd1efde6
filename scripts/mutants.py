"""Whether tests notice a wrong line: mutants of the code, one at a time, in a copy of the tree.

    python -m scripts.mutants [calibration …] [--only WORDS]
    python -m scripts.mutants --draw 40 --seed 1 [lab clinic/identify …]

`scripts/mutants/ROOM.toml` has one line for each mutant of a room: the file, a text that occurs
once in it, what replaces it, the tests that should fail, why it matters, and, for one that may
survive, why that does not matter. Every named test must pass before anything is changed. Prints
killed and survived, and ends with 1 if fewer than nine in ten are killed.

With `--draw` faults of one line are drawn instead, from all houses and rooms alike or from those
named (`scripts/drawn.py`), and the tests nearest to each file, at most three files of
them, must notice. A fault in a kernel's source runs as plain Python; one whose tests take longer
than `LONGEST` then counts as undecided. Lines that only word a message, and faults that change no
result, are among what is drawn: read the survivors.

Kernels are compiled in a cache of the copy's own, again where a mutant is in one of their sources.
Those of a room that is `interpreted` run as plain Python.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

from nsaid_mj.core.numerics.cache import kernel_sources
from scripts.drawn import drawn, nearest, rooms

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "scripts" / "mutants"
KILLED = 0.9  # least share
LONGEST = 120.0  # time in which the tests of a drawn fault must end [s]
TREES = ("nsaid_mj", "tests", "scripts", "assets", "scenarios")


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


def passes(
    folder: Path,
    tests: tuple[str, ...],
    interpreted: bool = False,
    longest: float | None = None,
) -> bool:
    """Whether tests pass in a copy of the tree, with kernels compiled or as plain Python.

    Raises:
        SystemExit: they cannot be run at all.
        TimeoutExpired: they take more than `longest` [s].
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    command += ["-n", "0", "-m", "not slow", *tests]
    own = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "kernels")}
    own |= {"NUMBA_DISABLE_JIT": "1"} if interpreted else {}
    environment = os.environ | {"OMP_NUM_THREADS": "1"} | own
    done = subprocess.run(
        command,
        check=False,
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=longest,
    )
    if done.returncode not in (0, 1, 2, 4):  # 2, 4: a file cannot be imported
        raise SystemExit(f"{' '.join(tests)}: {done.stdout[-500:]}{done.stderr[-500:]}")
    return done.returncode == 0


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
    compiled = kernel_sources()
    chosen = {
        room: files
        for room, files in rooms().items()
        if not names or any(f"{room}/".startswith(f"{name.rstrip('/')}/") for name in names)
    }
    fates: dict[str, list[str]] = {"killed": [], "SURVIVED": [], "undecided": []}
    sound: dict[tuple[tuple[str, ...], bool], bool] = {}
    for _ in range(count):
        room = rng.choice(sorted(chosen))
        fault = drawn(chosen[room], rng)
        tests = nearest(fault.file)
        interpreted = fault.file.removeprefix("nsaid_mj/").removesuffix(".py") in compiled
        path = folder / fault.file
        text = path.read_bytes()
        try:
            if (tests, interpreted) not in sound:
                sound[tests, interpreted] = passes(folder, tests, interpreted, LONGEST)
            path.write_text(fault.text, encoding="utf-8")
            wrong = not passes(folder, tests, interpreted, 2 * LONGEST)
            fate = (
                "undecided" if not sound[tests, interpreted] else "killed" if wrong else "SURVIVED"
            )
        except subprocess.TimeoutExpired:
            sound.setdefault((tests, interpreted), False)
            fate = "undecided"
        finally:
            path.write_bytes(text)
        fates[fate].append(room)
        print(f"{fate} {fault.file}:{fault.line}: {fault.before}  →  {fault.after}", flush=True)
        print(f"    {' '.join(tests)}", flush=True)
    decided = len(fates["killed"]) + len(fates["SURVIVED"])
    share = len(fates["killed"]) / max(decided, 1)
    print(f"{len(fates['killed'])} of {decided} killed ({share:.0%}), {count - decided} undecided")
    return int(share < KILLED)


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
