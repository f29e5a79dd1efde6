"""Detection and isolation of faults by the filter: hypotheses, their evidence, and their trials."""
