"""Compiled stages of a motion: one body, a tree, a tree with added mass. No Pinocchio."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
