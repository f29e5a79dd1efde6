"""Adaptive tracking, evaluated: `nsaid track`."""
