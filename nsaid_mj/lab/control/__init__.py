"""Excitation: drivers that command a plant during identification, without its true parameters."""
