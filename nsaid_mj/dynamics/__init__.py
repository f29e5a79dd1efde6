"""Compiled stages of a motion: one body, a tree, a tree with added mass. No Pinocchio."""

from .. import numerics as numerics  # where kernels are kept: before the first one
