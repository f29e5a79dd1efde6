"""Faults as text: `loss 0.4 of 2 at 5 s; payload 1 kg at 10 s until 15 s`.

A fault is its kind, one number if the kind has one, and keywords with their values in any order:

    loss 40 % of 2                    loss 0.3 of 2 rate 1 %/s        (slowly)
    reversed 2                        broken 2
    stuck 2                           stuck 2 holding 0.3
    friction 1.5 of viscous_3         payload 1 kg place 0 0 0.1 m on link 6
    bias 0.01 of position 2           bias -0.05 of velocity 1

and for all of them `at 5 s` and `until 9 s`. Units are optional; `%` divides by 100.
"""

import re
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator

from .....base import InvalidInput
from .kinds import Bias, Broken, Fault, Friction, Loss, Payload, Reversed, Stuck

_KINDS: dict[str, tuple[type[Fault], dict[str, str]]] = {
    "loss": (Loss, {"": "share", "of": "actuator", "rate": "rate"}),
    "reversed": (Reversed, {"": "actuator"}),
    "broken": (Broken, {"": "actuator"}),
    "stuck": (Stuck, {"": "actuator", "holding": "holding"}),
    "friction": (Friction, {"": "by", "of": "parameter"}),
    "payload": (Payload, {"": "mass", "place": "place", "on": "link"}),
    "bias": (Bias, {"": "by", "of": "sensor"}),
}
_TIMES = {"at": "time", "until": "until"}
_WORDS = ("parameter", "link", "sensor")  # fields whose value is text
_UNITS = {"share": "%", "rate": "%/s", "time": "s", "until": "s", "mass": "kg", "place": "m"}
_HELP = "Write for instance: loss 0.4 of 2 at 5 s; payload 1 kg at 10 s until 15 s"
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(\D*)")


def parse_faults(text: str) -> tuple[Fault, ...]:
    """The faults of a text, separated by semicolons.

    Raises:
        InvalidInput: it is not of the form above, or a value is out of its range.
    """
    return tuple(parse_fault(part) for part in text.split(";") if part.strip())


def parse_fault(text: str) -> Fault:
    """One fault; see `parse_faults`."""
    kind, *tokens = text.split()
    if kind not in _KINDS:
        raise InvalidInput("faults", f"a kind out of {', '.join(_KINDS)}", repr(kind), _HELP)
    cls, keywords = _KINDS[kind]
    keywords = keywords | _TIMES
    given: dict[str, list[str]] = {}
    word = ""
    for token in tokens:
        if token in keywords:
            word = token
            if word in given:
                raise InvalidInput("faults", f"{word!r} once", repr(text.strip()), _HELP)
            given[word] = []
        elif not given and not word:
            given[""] = [token]
        else:
            given.setdefault(word, []).append(token)
    values: dict[str, Any] = {}
    for word, parts in given.items():
        values |= _value(keywords[word], parts, text)
    return cls(**values)


def _value(name: str, parts: Sequence[str], text: str) -> dict[str, Any]:
    """A field's value from its words."""
    if not parts:
        raise InvalidInput(f"faults.{name}", "a value after its keyword", repr(text), _HELP)
    if name == "sensor":
        channel = [n for n in _numbers(name, parts[1:], text) if n.is_integer()]
        if len(channel) != 1:
            raise InvalidInput("faults.sensor", "such as position 2", repr(" ".join(parts)), _HELP)
        return {"sensor": parts[0], "channel": int(channel[0])}
    if name in _WORDS:
        return {name: " ".join(parts)}
    found = _numbers(name, parts, text)
    if name == "place":
        return {name: tuple(found)}
    if len(found) != 1:
        raise InvalidInput(f"faults.{name}", "one number", repr(" ".join(parts)), _HELP)
    whole = name == "actuator" and found[0].is_integer()
    return {name: int(found[0]) if whole else found[0]}


def _numbers(name: str, parts: Sequence[str], text: str) -> list[float]:
    """The numbers in a value, without its unit."""
    unit = _UNITS.get(name, "")
    found = []
    for part in parts:
        matched = _NUMBER.fullmatch(part)
        suffix = matched[2] if matched else part
        if suffix and (suffix != unit or (not matched and not found)):
            expected = "a number" + (f" in {unit}" if unit else "")
            raise InvalidInput(f"faults.{name}", expected, f"{part!r} in {text.strip()!r}", _HELP)
        if matched:
            found.append(float(matched[1]))
        if suffix.startswith("%"):
            found[-1] /= 100
    return found


def fault_text(fault: Fault) -> str:
    """A fault as text, which `parse_fault` reads back; the class's name for other kinds."""
    for kind, (cls, keywords) in _KINDS.items():
        if type(fault) is cls:
            words = [kind]
            for word, name in (keywords | _TIMES).items():
                value = getattr(fault, name)
                if value not in (None, ""):
                    items = value if isinstance(value, tuple) else (value,)
                    shown = [repr(x) if isinstance(x, float) else str(x) for x in items]
                    words += [word, *shown] if word else shown
                if name == "sensor":
                    words.append(str(getattr(fault, "channel")))  # noqa: B009 (of this kind only)
            return " ".join(words)
    return type(fault).__name__


def _read(value: Any) -> Any:
    """Accepts text, and text among the items of a sequence."""
    if isinstance(value, str):
        return parse_faults(value)
    if isinstance(value, list | tuple):
        parts = [parse_faults(v) if isinstance(v, str) else (v,) for v in value]
        return tuple(fault for part in parts for fault in part)
    return value


Faults = Annotated[tuple[Fault, ...], BeforeValidator(_read)]
"""Any number of faults; also as text."""
