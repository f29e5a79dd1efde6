"""The command: runs the cases, writes a line for each, prints the tables."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any

from .cases import LAWS, TOGETHER, Case, drawn
from .effects import EFFECTS, FAULTS
from .judging import CONFIDENT, CRASH, NOT_RUN, WRONG, Judgement, judge_online
from .online import identified, trace_of
from .simulation import NotRun, simulated
from .table import Line, bars, by_effect, kind_of, overall, worst

LIMIT = 120.0  # computing time of a run [s]; the first ones on a machine compile kernels


class TooSlow(Exception):
    """A run took longer than its limit."""


def judged(case: Case) -> Judgement:
    """Simulates a case, identifies it and judges what was said."""
    if case.law == "identify":
        from .offline import judged_offline

        return judged_offline(case)
    found = simulated(case)
    plant = found.setup.plant
    said = judge_online(identified(found), found.setup.system, case.effect, plant.faults)
    if (said.truth, said.manner) == (WRONG, CONFIDENT) and case.effect != "none":
        said.figures["trace"] = trace_of(case)
    return said


def line_of(case: Case, limit: float = LIMIT, verbose: bool = False) -> Line:
    """Runs a case: the entries of its line are the case and what the judgement says."""
    line = attempt(lambda: judged(case).keys(), limit, verbose)
    return {"case": asdict(case), "words": case.words} | line


def attempt(run: Callable[[], Line], limit: float = LIMIT, verbose: bool = False) -> Line:
    """Runs something; exceptions count as crashes, and computing time is limited [s].

    Returns:
        What it returns, `outcome` (`judged`, `crash` or `not run`) and `seconds`.
    """

    def late(*_: object) -> None:
        raise TooSlow(f"longer than {limit:g} s")

    line: Line = {"outcome": "judged"}
    before, begin = signal.signal(signal.SIGPROF, late), time.process_time()
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            line |= run()
    except NotRun as error:
        line |= {"outcome": NOT_RUN, "error": str(error)}
    except Exception as error:
        if verbose:
            traceback.print_exc()
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if "site-packages" not in frame.filename]
        where = f"{Path(own[-1].filename).name}:{own[-1].lineno}"
        line |= {"outcome": CRASH, "error": f"{type(error).__name__} at {where}: {error}"[:400]}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    return line | {"seconds": round(time.process_time() - begin, 2)}


def cases(seed: int, laws: Sequence[str], only: str) -> Iterator[Case]:
    """The cases of a seed, in order, all or those of one kind."""
    for number in count():
        case = drawn(seed, number, laws)
        kinds = {case.effect, "exact" if case.effect == "none" else "effects"}
        if case.effect in FAULTS:
            kinds = {case.effect, "faults"}
        if only in ("", *kinds):
            yield case


def read(path: Path) -> list[Line]:
    """The lines of a study's file; of a run that was repeated, the last."""
    lines = [json.loads(text) for text in path.read_text("utf-8").splitlines() if text.strip()]
    return list({(*line["laws"], line["case"]["number"]): line for line in lines}.values())


def _shown(line: Line) -> str:
    reasons = [*line.get("wrong", []), *line.get("flagged", []), *line.get("unsure", [])]
    reasons += [line["error"]] if "error" in line else []
    return f"{kind_of(line):17} {line['seconds']:5.1f} s  {line['words']}  {'; '.join(reasons)}"


def study(arguments: argparse.Namespace) -> list[Line]:
    """Runs the cases that are not in the file yet, and appends them to it."""
    laws, path = list(arguments.law), arguments.json
    chosen = list(islice(cases(arguments.seed, laws, arguments.only), arguments.runs))
    known = read(path) if path is not None and path.is_file() else []
    wanted = [asdict(case) for case in chosen]
    lines = [line for line in known if line["laws"] == laws and line["case"] in wanted]
    done = {line["case"]["number"] for line in lines}
    left = [case for case in chosen if case.number not in done]
    for line in in_processes(left, partial(line_of, limit=arguments.limit), arguments.jobs):
        line["laws"] = laws
        lines.append(line)
        print(_shown(line), flush=True)
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line, ensure_ascii=False) + "\n")
    return lines


def in_processes(left: Sequence[Any], run: Callable[[Any], Line], jobs: int) -> Iterator[Line]:
    """The lines of cases, in one process or several, in any order."""
    if jobs == 1:
        yield from map(run, left)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(run, left, chunksize=TOGETHER)


def tables(lines: Sequence[Line]) -> str:
    """All tables, and the runs that are wrong and confident or crashed."""
    return f"{overall(lines)}\n\n{bars(lines)}\n\n{by_effect(lines)}\n\n{worst(lines)}"


def main(words: Sequence[str], description: str | None) -> None:
    """The command line of the family `effects`."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--law", nargs="+", choices=LAWS, default=list(LAWS))
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    only = ("exact", "effects", "faults", *EFFECTS)
    parser.add_argument("--only", default="", choices=only, metavar="KIND", help=", ".join(only))
    parser.add_argument("--json", type=Path, help="a line for each run; a study goes on from it")
    parser.add_argument("--limit", type=float, default=LIMIT, help="computing time of a run [s]")
    parser.add_argument("--case", type=int, help="number of one run, which is told at length")
    parser.add_argument("--tables", type=Path, help="only print the tables of such a file")
    arguments = parser.parse_args(words)
    if arguments.tables is not None:
        print(tables(read(arguments.tables)))
        return
    if arguments.case is not None:
        case = drawn(arguments.seed, arguments.case, arguments.law)
        line = line_of(case, arguments.limit, verbose=True)
        print(json.dumps(line, indent=1, ensure_ascii=False))
        return
    print(f"\n{tables(study(arguments))}")
