"""Lines and texts of a drawing, read from its SVG."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from nsaid_mj.report.page import VARIABLES


def points_of(drawing: ElementTree.Element, colour: str) -> np.ndarray:
    """(k, 2) the points of the one line of a colour."""
    (path,) = (p for p in drawing.iter("path") if f"({VARIABLES[colour]}," in str(p.get("style")))
    numbers = [float(word) for word in str(path.get("d")).split() if word not in "ML"]
    return np.array(numbers).reshape(-1, 2)


def words_of(text: str) -> set[str]:
    """All texts of a drawing."""
    return {"".join(element.itertext()) for element in ElementTree.fromstring(text).iter("text")}
