"""Live identification: samples arrive from a robot while it moves."""
