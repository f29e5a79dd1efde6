"""The statistically efficient law: a Kalman filter of state and parameters."""
