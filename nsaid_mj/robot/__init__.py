"""Model files in and out: a robot from its URDF or MJCF, and its file with other numbers."""
