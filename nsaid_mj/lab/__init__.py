"""Simulated robots: plants, drivers, scenarios, the loop, the record, and what is said of a run."""
