"""Reads robots from URDF or MJCF files, and writes these files with identified values."""
