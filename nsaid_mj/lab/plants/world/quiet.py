"""MuJoCo without its log file."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def quiet() -> Iterator[None]:
    """Context in which MuJoCo's warnings are neither printed nor written to MUJOCO_LOG.TXT.

    MuJoCo creates that file in the current folder, which is the user's.
    """
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(handler)
