"""What a try is, how it is carried out, and what is wrong with how `nsaid …` ends."""

from __future__ import annotations

import contextlib
import io
import random
import shutil
import signal
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from nsaid_mj.base.errors import NsaidError

from ..support.faulty import shell

LIMIT = 600
"""Wall time after which a try counts as hanging [s]; compiling kernels may take minutes."""


class Try(NamedTuple):
    """A try that was carried out.

    Attributes:
        name: what was tried, and the number that repeats it.
        wrong: what went wrong; "" if nothing did.
    """

    name: str
    wrong: str


class Kind(NamedTuple):
    """What a try does, drawn but not yet carried out.

    Attributes:
        name: in a few words.
        check: carries it out; returns what went wrong, "" if nothing did.
    """

    name: str
    check: Callable[[], str]


def drawn_number(rng: random.Random) -> float:
    """A number of any size that a float can have, from 5e-324 to 1e308, of either sign."""
    return rng.choice((1.0, 1.0, -1.0)) * max(10 ** rng.uniform(-324, 308), 5e-324)


Draw = Callable[[random.Random, Path], Kind]
"""Draws a try, which may use the empty folder."""


class Hang(BaseException):
    """A try took too long; no `except Exception` can swallow it."""


def carried_out(family: str, draw: Draw, tries: int, seed: int) -> Iterator[Try]:
    """Tries of a family, each with random numbers and a folder of its own."""
    for number in range(tries):
        folder = Path(tempfile.mkdtemp(prefix="campaign-"))
        try:
            kind = draw(random.Random(f"{family} {seed} {number}"), folder)
            yield Try(f"{number}, {kind.name}", wrong_with(kind.check))
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def wrong_with(check: Callable[[], str]) -> str:
    """What goes wrong in a check: what it returns, any exception, or that it hangs."""
    kept = signal.signal(signal.SIGALRM, _hang)
    signal.alarm(LIMIT)
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            return check()
    except Hang:
        return f"longer than {LIMIT} s"
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:300]} ({last.name})"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, kept)


def _hang(*_: object) -> None:
    raise Hang


def typed(action: Callable[[], str]) -> str:
    """What goes wrong in an action that may end in a typed error with a message."""
    try:
        return action()
    except NsaidError as error:
        return "" if str(error) else "an error without a message"


class Ended(NamedTuple):
    """How `nsaid …` has ended.

    Attributes:
        wrong: a traceback, an unknown exit code, or a refusal without a word; "" otherwise.
        code: exit code.
        out: what it wrote on standard output.
        err: what it wrote on standard error.
    """

    wrong: str
    code: int
    out: str
    err: str


def nsaid(words: Sequence[str], folder: Path) -> Ended:
    """How `nsaid …` ends in a folder, in this process."""
    with contextlib.chdir(folder):
        code, said = shell(*words)
    wrong = ""
    if "Traceback" in said.err + said.out:
        wrong = f"a traceback: {said.err[-300:]}"
    elif code not in (0, 1, 2):
        wrong = f"exit code {code}: {said.err[-300:]}"
    elif code == 2 and not (said.err + said.out).strip():
        wrong = "refused without a word"
    return Ended(wrong, code, said.out, said.err)
