"""Model files in and out: a robot from its URDF or MJCF, and its file with other numbers."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
