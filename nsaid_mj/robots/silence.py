"""MuJoCo without its log file."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def quiet() -> Iterator[list[str]]:
    """Context in which MuJoCo's warnings are neither printed nor written to MUJOCO_LOG.TXT.

    MuJoCo creates that file in the current folder, which is the user's. Yields the list to which
    the warnings are added.
    """
    handler = mujoco.get_mju_user_warning()
    heard: list[str] = []
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield heard
    finally:
        mujoco.set_mju_user_warning(handler)
