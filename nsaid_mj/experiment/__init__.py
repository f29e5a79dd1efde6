"""An experiment: the scenario as data, the assembly of its parts, the time loop, the record."""
