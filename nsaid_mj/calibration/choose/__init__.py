"""What a log decides about a robot's structure: columns, delays, lags, curves and cut-offs."""
