"""Faults of a plant during a run: their kinds, as text, and their effect in time."""
