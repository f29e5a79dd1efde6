"""An experiment: the scenario as data, the wiring of its parts, the time loop, the record."""
