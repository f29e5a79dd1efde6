"""Hypothesis strategies that many rooms draw from."""

from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
"""Seeds of a `numpy.random.Generator`."""
