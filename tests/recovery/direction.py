"""The direction of θ that a scenario converges to, and where it is stored.

A direction is θ̂/scale with its length made 1 and its largest entry made positive: what is left
of an estimate when the common scale, which nobody can observe, is taken away.
"""

import json
from pathlib import Path

import numpy as np

from nsaid_mj.lab.control.adaptive.tracker import AdaptiveTracking
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import Run, run
from nsaid_mj.robots.assets import scenarios

FOLDER = Path(__file__).parent / "directions"
TOLERANCE = 5e-6
"""Largest change of an entry that is not seen as one. Rounding differs between machines: one gave a
direction of `wrist_first`, whose last steps hardly excite some masses, that was 1.4e-6 off."""


def names() -> list[str]:
    """The packed scenarios that identify.

    Those that track are judged by the errors of their motion (tests/lab/control): they follow a
    reference that need not tell the parameters apart, and adaptive tracking does not need it.
    """
    return [n for n in scenarios() if not isinstance(load(n).excitation, AdaptiveTracking)]


def of(estimate: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(p,) unit direction of an estimate."""
    direction = estimate / scale
    direction = direction / np.linalg.norm(direction)
    return direction * np.sign(direction[np.argmax(np.abs(direction))])


def converge(name: str, folder: Path) -> tuple[Run, dict[str, float]]:
    """Runs a packed scenario; returns the run and its last direction by parameter name."""
    result = run(load(name), folder)
    space = result.plant.system.space
    direction = of(result.record["theta_hat"][-1], space.scale)
    return result, dict(zip(space.names, direction.tolist(), strict=True))


def stored(name: str) -> dict[str, float]:
    """The stored direction; empty if there is none."""
    path = FOLDER / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def store(name: str, direction: dict[str, float]) -> None:
    """Stores a direction, one line for each parameter, so that a diff names what moved."""
    rounded = {key: float(f"{value:.9f}") for key, value in direction.items()}
    text = json.dumps(rounded, indent=1, ensure_ascii=False)
    (FOLDER / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def changes(old: dict[str, float], new: dict[str, float]) -> list[str]:
    """What moved by more than the tolerance: name, old, new."""
    return [
        f"{key:12} {old.get(key, float('nan')):+.9f} -> {new.get(key, float('nan')):+.9f}"
        for key in dict.fromkeys([*old, *new])
        if key not in old or key not in new or abs(old[key] - new[key]) > TOLERANCE
    ]
