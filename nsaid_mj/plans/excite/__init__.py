"""Design of experiments: finds the most informative motion within limits."""
