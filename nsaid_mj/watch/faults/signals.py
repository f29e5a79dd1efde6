"""The acting signals that known and supposed faults imply."""

from collections.abc import Sequence

import numpy as np

from ...core import FaultEvent, SecondOrderSystem, Signals
from .hypotheses import Hypothesis


def signals_after(system: SecondOrderSystem, events: Sequence[FaultEvent]) -> Signals:
    """The signals that act once some faults have happened."""
    sign, held, bias = Signals.sound(system)
    commands = {
        tuple(system.space.names[i] for i in k): command
        for command, k in enumerate(system.gains_by_command)
    }
    for event in events:
        command = commands.get(tuple(event.names), -1)
        if event.kind == "bias":
            sensor, _, number = event.names[0].partition(" ")
            bias[(sensor == "velocity") * system.n + int(number) - 1] = event.size
        elif event.kind == "reversed" and command >= 0:
            sign[command] = -sign[command]
        elif event.kind in {"broken", "stuck"} and command >= 0:
            held[command] = event.size if event.kind == "stuck" else 0.0
    return Signals(sign, held, bias)


def signals_under(signals: Signals, hypothesis: Hypothesis) -> Signals:
    """The signals that act if a hypothesis about an actuator holds as well."""
    sign = signals.sign.copy()
    held = signals.held.copy()
    k = hypothesis.command
    if hypothesis.kind == "sound":
        sign[k] = 1.0
        held[k] = np.nan
    elif hypothesis.kind == "reversed":
        sign[k] = -sign[k]
        held[k] = np.nan
    elif k >= 0:
        held[k] = hypothesis.held
    return signals._replace(sign=sign, held=held)
