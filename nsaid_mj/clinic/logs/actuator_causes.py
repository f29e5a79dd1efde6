"""Which of a vehicle's commands are swapped or reversed, by the forces of its sheet.

Plugs of thrusters are exchanged, and motors turn the other way. Each command is tried in every
actuator's place, with either sign; of all exchanges the one is sought under which the sheet's
forces balance best, step by step.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Array

Mask = NDArray[np.bool_]

_WORTH = 0.9  # ratio of errors below which one more exchange is made
_HANDICAP = 1.03  # of the errors, for each command that is changed
_POOR = 0.3  # largest error of the sheet's forces up to which no command is doubted
_REWIRED = 0.7  # ratio of all errors below which other wiring is certain
_WORSE = 1.1  # ratio of the errors of one velocity from which it is not believed
_SMALL = 0.2  # error that such a velocity may have anyhow


class Wiring(NamedTuple):
    """Which command every actuator follows."""

    source: tuple[int, ...]  # (k,) number of the command, for each actuator
    sign: tuple[int, ...]  # (k,) 1, or −1 where it is reversed

    def changes(self, names: list[str]) -> dict[str, object]:
        """The lines of map.toml that undo it, for actuators of such names."""
        found: dict[str, object] = {}
        swapped = {names[k]: names[j] for k, j in enumerate(self.source) if k != j}
        reversed_ = {names[k]: -1 for k, s in enumerate(self.sign) if s < 0}
        if swapped:
            found["order.command"] = swapped
        if len(reversed_) == len(names):
            found["factors.command"] = -1
        elif reversed_:
            found["factors.command"] = reversed_
        return found

    def in_words(self, names: list[str]) -> str:
        """What is wrong with the commands."""
        said = []
        swapped = [names[k] for k, j in enumerate(self.source) if k != j]
        if swapped:
            own = [names[j] for k, j in enumerate(self.source) if k != j]
            said.append(
                f"the commands of {', '.join(swapped)} are in the columns of {', '.join(own)}"
            )
        turned = [names[k] for k, s in enumerate(self.sign) if s < 0]
        if len(turned) == len(names):
            said.append("all commands are reversed")
        elif turned:
            said.append(f"the command of {', '.join(turned)} is reversed")
        return " and ".join(said)


def rewired(
    error: Callable[[Wiring], Array], signed: Mask, driven: Mask
) -> tuple[Wiring, Array] | None:
    """The wiring with the least error, and its errors (n,); None if it is that of the map.

    `error` maps a wiring to the (n,) errors of the velocities, `driven` (n,) are those on which
    actuators act, `signed` (k,) says which commands are ever negative: others have no sign.
    """
    count = len(signed)
    given = Wiring(tuple(range(count)), (1,) * count)
    own = error(given)
    if not own[driven].max(initial=0.0) > _POOR:
        return None

    def cost(wiring: Wiring) -> float:
        return size_of(error(wiring), driven) * _HANDICAP ** _changed(wiring)

    starts = [given]
    if signed.all():
        starts.append(Wiring(given.source, (-1,) * count))
    found = [_best_near(start, cost, signed) for start in starts]
    size, best = min(found, key=lambda one: one[0])
    after = error(best)
    worse = after > np.maximum(_WORSE * own, _SMALL)
    if best == given or not size < _REWIRED * size_of(own, driven) or worse[driven].any():
        return None
    return best, after


def _best_near(
    start: Wiring, cost: Callable[[Wiring], float], signed: Mask
) -> tuple[float, Wiring]:
    """The least cost and its wiring, by exchanges one after another."""
    best = start
    least = cost(start)
    for _ in start.source:
        trials = [(cost(wiring), wiring) for wiring in _near(best, signed)]
        size, wiring = min(trials, key=lambda one: one[0], default=(np.inf, start))
        if not size < _WORTH * least:
            break
        least = size
        best = wiring
    return least, best


def size_of(errors: Array, driven: Mask) -> float:
    """Root mean square of the errors (n,) of driven velocities."""
    return float(np.sqrt(np.mean(errors[driven] ** 2)))


def _changed(wiring: Wiring) -> int:
    """How many actuators follow another command, or the reversed one; all reversed are one."""
    moved = sum(k != j for k, j in enumerate(wiring.source))
    turned = sum(sign < 0 for sign in wiring.sign)
    return moved + (1 if turned == len(wiring.sign) else turned)


def _near(wiring: Wiring, signed: Mask) -> Iterator[Wiring]:
    """Wirings with one command reversed, or two exchanged and perhaps reversed."""
    count = len(signed)
    for k in range(count):
        if signed[wiring.source[k]]:
            yield _with(wiring, {k: wiring.source[k]}, {k: -wiring.sign[k]})
    for i, j in itertools.combinations(range(count), 2):
        swapped = {i: wiring.source[j], j: wiring.source[i]}
        signs = [(1, -1) if signed[k] else (1,) for k in swapped.values()]
        for one, other in itertools.product(*signs):
            turned = {i: one * wiring.sign[j], j: other * wiring.sign[i]}
            yield _with(wiring, swapped, turned)


def _with(wiring: Wiring, source: dict[int, int], sign: dict[int, int]) -> Wiring:
    """A wiring with some commands and signs in place of its own."""
    count = range(len(wiring.source))
    sources = tuple(source.get(k, wiring.source[k]) for k in count)
    return Wiring(sources, tuple(sign.get(k, wiring.sign[k]) for k in count))
