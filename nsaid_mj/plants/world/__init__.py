"""MuJoCo as the world: stepping, callbacks, coordinates, sensors, faults."""
