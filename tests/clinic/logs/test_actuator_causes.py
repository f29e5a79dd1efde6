"""Commands of a vehicle that are exchanged or reversed, told by the errors of its forces."""

import numpy as np
import pytest

from nsaid_mj.clinic.logs.actuator_causes import Wiring, rewired

NAMES = ["bow", "port", "starboard", "stern"]
DRIVEN = np.array([True, True, False])


def problem(true: Wiring, seed: int, noise: float):
    """Errors of three velocities, of which commands drive two, under a wiring."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(400, 4))
    B = rng.normal(size=(2, 4))
    acting = u[:, list(true.source)] * true.sign @ B.T
    needed = acting + noise * acting.std() * rng.normal(size=acting.shape)

    def errors(wiring: Wiring) -> np.ndarray:
        own = u[:, list(wiring.source)] * wiring.sign @ B.T
        size = np.sqrt(np.mean(own**2 + needed**2, axis=0))
        return np.append(np.sqrt(np.mean((own - needed) ** 2, axis=0)) / size, 1.0)

    return errors


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "true",
    [
        Wiring((0, 1, 2, 3), (-1, -1, -1, -1)),
        Wiring((0, 1, 2, 3), (1, 1, -1, 1)),
        Wiring((0, 2, 1, 3), (1, 1, 1, 1)),
        Wiring((0, 2, 1, 3), (1, 1, -1, 1)),
        Wiring((1, 0, 3, 2), (1, 1, 1, 1)),
    ],
)
def test_the_wiring_is_found(true, seed):
    found = rewired(problem(true, seed, 0.1), np.ones(4, bool), DRIVEN)
    assert found is not None and found[0] == true


@pytest.mark.parametrize("seed", range(8))
def test_noise_alone_is_no_other_wiring(seed):
    given = Wiring((0, 1, 2, 3), (1, 1, 1, 1))
    assert rewired(problem(given, seed, 1.0), np.ones(4, bool), DRIVEN) is None


def test_commands_that_are_never_negative_have_no_sign():
    true = Wiring((0, 1, 2, 3), (1, 1, -1, 1))
    found = rewired(problem(true, 0, 0.1), np.zeros(4, bool), DRIVEN)
    assert found is None or found[0].sign == (1, 1, 1, 1)


def test_a_wiring_is_told_in_lines_of_the_map():
    wiring = Wiring((0, 2, 1, 3), (1, 1, -1, 1))
    assert wiring.changes(NAMES) == {
        "order.command": {"port": "starboard", "starboard": "port"},
        "factors.command": {"starboard": -1},
    }
    words = wiring.in_words(NAMES)
    assert "commands of port, starboard are in the columns of starboard, port" in words
    assert "the command of starboard is reversed" in words
    every = Wiring((0, 1, 2, 3), (-1, -1, -1, -1))
    assert every.changes(NAMES) == {"factors.command": -1}
