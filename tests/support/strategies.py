"""Hypothesis strategies shared by the tests."""

from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
"""Seeds of a `numpy.random.Generator`."""
