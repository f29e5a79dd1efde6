"""What the families of the fault campaign on folders and processes have in common."""

from __future__ import annotations

import random
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from nsaid_mj.errors import NsaidError


class Try(NamedTuple):
    """A try.

    Attributes:
        name: what was tried, and the number that repeats it.
        outcome: `ok` or `wrong`.
        words: what went wrong.
    """

    name: str
    outcome: str
    words: str


class Kind(NamedTuple):
    """What a try does, drawn but not yet carried out.

    Attributes:
        name: in a few words.
        check: carries it out; returns what went wrong, "" if nothing did.
    """

    name: str
    check: Callable[[], str]


Draw = Callable[[random.Random, Path], Kind]
"""Draws a try, which may use the empty folder."""


def typed(action: Callable[[], str]) -> str:
    """What went wrong in an action that may end in a typed error with a message."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return action()
        except NsaidError as error:
            return "" if str(error) else "an error without a message"


def carried_out(family: str, draw: Draw, tries: int, seed: int) -> Iterator[Try]:
    """Tries of a family, each with random numbers and a folder of its own."""
    for number in range(tries):
        folder = Path(tempfile.mkdtemp(prefix="campaign-"))
        try:
            kind = draw(random.Random(f"{family} {seed} {number}"), folder)
            try:
                wrong = kind.check()
            except Exception as error:  # whatever it is, it is a failure of the try
                wrong = f"{type(error).__name__}: {str(error)[:300]}"
            yield Try(f"{number}, {kind.name}", "wrong" if wrong else "ok", wrong)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
