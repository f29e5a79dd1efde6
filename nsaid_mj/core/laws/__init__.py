"""Identifiers: one file per law, over one engine. numpy and numba only."""
