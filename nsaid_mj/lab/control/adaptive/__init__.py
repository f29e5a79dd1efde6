"""Adaptive tracking control with nullspace estimates, and other laws for comparison."""
