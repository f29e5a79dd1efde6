"""The structure an identifier knows. Never imports mujoco, holds no true value."""

from .. import numerics as numerics  # where kernels are kept: before the first one
