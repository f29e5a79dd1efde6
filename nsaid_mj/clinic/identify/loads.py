"""Weighed loads, as the command line states them."""

import re
from typing import NamedTuple

from ...base import LARGEST, InvalidInput

_FORM = "FILE:MASSkg, FILE:MASSkg@LINK or FILE:MASSkg@LINK:X,Y,Z"
_TEXT = re.compile(
    r"(?P<file>.+):(?P<mass>[0-9.eE+-]+) *(?P<unit>kg|g)?(@(?P<link>[^:]+)(:(?P<place>[^:]+))?)?"
)


class Load(NamedTuple):
    """A weighed payload."""

    source: str  # name of the file that carries it
    mass: float  # [kg]
    # body, joint or frame of the model that it is fixed to; "" for the last link that does not
    # belong to a gripper
    link: str = ""
    # (3,) its centre of mass in the frame of that link [m]; None if unknown
    centre: tuple[float, ...] | None = None
    weighed: bool = True  # whether the mass is known, or only about the one stated


def load_of(text: str) -> Load:
    """A load as the command line states it, such as `loaded.csv:0.25kg@gripper`.

    Raises:
        InvalidInput: the text has another form, or the mass is not positive.
    """
    found = _TEXT.fullmatch(text.strip())
    try:
        if found is None:
            raise ValueError
        mass = float(found["mass"]) * (1e-3 if found["unit"] == "g" else 1.0)
        place = found["place"]
        centre = None if place is None else tuple(float(x) for x in place.split(","))
        known = centre is None or (len(centre) == 3 and all(abs(x) <= LARGEST for x in centre))
        if not (0 < mass <= LARGEST and known):
            raise ValueError
    except ValueError as error:
        raise InvalidInput("--load", _FORM, text, "Such as loaded.csv:0.25kg@gripper.") from error
    return Load(re.split(r"[/\\]", found["file"])[-1], mass, found["link"] or "", centre)
