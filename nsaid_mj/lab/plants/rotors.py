"""The forces of rotors, of quadrotors and of what else flies on them."""

from collections.abc import Sequence

import numpy as np

from ...core import Array, Term

_UP = (0.0, 0.0, 1.0)


def rotor_terms(
    points: Array, spins: Sequence[float], thrust: float, torque: float, spread: float = 1.0
) -> list[Term]:
    """Thrust [N] along z and torque [N·m] about z of r rotors at full command, each with its own.

    points (r, 3) are on the first body [m]; spins (r,) ±1 are the signs of the torques; `spread` is
    that of the torque, see `Term`.
    """
    up = np.broadcast_to(_UP, (len(points), 3))
    about = np.multiply.outer(spins, _UP)
    turning = {"direction": about, "spread": spread}
    return [
        Term.actuators("rotor", "thrust", "thrust of rotor", thrust, point=points, direction=up),
        Term.actuators("rotor_torque", "torque", "torque of rotor", torque, **turning),
    ]
