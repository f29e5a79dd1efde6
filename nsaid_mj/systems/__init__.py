"""The structure an identifier knows. Never imports mujoco, holds no true value."""
