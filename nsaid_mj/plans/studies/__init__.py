"""Studies of many runs: comparison of methods, parameter sweeps, Monte Carlo."""
