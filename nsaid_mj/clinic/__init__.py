"""A user's own robot: from its logs to its parameters and its calibrated model."""
