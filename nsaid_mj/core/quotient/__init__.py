"""Rows → Gramians → scale-invariant cost and prior → steps in the cone → intervals."""
