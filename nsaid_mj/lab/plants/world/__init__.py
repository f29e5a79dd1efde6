"""The MuJoCo side of a plant: stepping, callbacks, coordinates, sensors, faults."""
