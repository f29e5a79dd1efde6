"""The structure an identifier knows. Never imports mujoco, holds no true value."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
