"""Fixtures for tests of servos."""

import numpy as np
import pytest


@pytest.fixture
def no_profile_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """For logs whose targets nothing limits or smooths: the search takes two fifths of the time.

    `test_recovery.py` shows that it finds none on such logs, `test_profiles.py` what it finds.
    """
    nothing = np.zeros(3), ()
    monkeypatch.setattr("nsaid_mj.clinic.servos.identify.hidden_profile", lambda logs: nothing)
