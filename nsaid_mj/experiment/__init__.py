"""An experiment: the scenario as data, its parts wired together, the time loop, the record."""
