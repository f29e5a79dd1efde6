"""Compiled loops' view of a system: a motion's stages, forward dynamics, information."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
