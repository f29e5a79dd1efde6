"""Rows → Gramians → scale-invariant cost and prior → steps in the cone → intervals."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
