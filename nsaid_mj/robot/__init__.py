"""Reads robots from URDF or MJCF files, and writes these files with identified values."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
