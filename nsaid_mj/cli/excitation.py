"""The flag `--excitation` of `nsaid run`, which is no field of a scenario."""

from __future__ import annotations

from collections.abc import Sequence

from ..base import BadRun, InvalidInput, path_of


def without_excitation(arguments: Sequence[str]) -> tuple[str, Sequence[str]]:
    """The value of `--excitation` on a command line, "" without it, and the other arguments.

    Raises:
        InvalidInput: the value is missing.
    """
    rest = list(arguments)
    given = ""
    for k, argument in enumerate(rest):
        flag, equals, value = argument.partition("=")
        if flag != "--excitation":
            continue
        if not equals and k + 1 == len(rest):
            raise InvalidInput("--excitation", "`designed` or `designed:FOLDER`", "nothing", "")
        given = value if equals else rest[k + 1]
        del rest[k : k + (1 if equals else 2)]
        break
    return given, rest


def check_excitation(given: str) -> None:
    """Checks the value of `--excitation`: `designed` or `designed:FOLDER`; "" is none.

    Raises:
        InvalidInput: the value is neither.
        BadRun: the folder holds no design.
    """
    word, colon, folder = given.partition(":")
    if given and word != "designed":
        expected = "`designed`, or `designed:FOLDER` of an earlier `nsaid excite`"
        raise InvalidInput("--excitation", expected, given, "All else is in the scenario's script.")
    if colon and not (path_of(folder) / "scenario.json").is_file():
        raise BadRun(folder, "there is no design", "Give the folder that `nsaid excite` wrote")
