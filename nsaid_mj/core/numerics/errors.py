"""Warnings about the cache of compiled kernels."""

from __future__ import annotations


class DamagedKernelCache(UserWarning):
    """A cached kernel cannot be loaded and is compiled again.

    Attributes:
        reason: the error.
    """

    def __init__(self, reason: object):
        self.reason = reason
        super().__init__(
            f"the cache of compiled kernels is damaged ({reason}); what cannot be loaded is "
            "compiled again, which takes about half a minute."
        )


class NoKernelCache(UserWarning):
    """Compiled kernels cannot be cached, so that every process compiles them again.

    Attributes:
        reason: the operating system's error.
    """

    def __init__(self, reason: object):
        self.reason = reason
        super().__init__(
            f"compiled kernels cannot be cached ({reason}), so each run compiles them again, which "
            "takes about half a minute. Set NUMBA_CACHE_DIR to a writable folder."
        )
