"""Adaptive tracking control with nullspace estimates, and other laws for comparison."""

from .tracker import AdaptiveTracking as AdaptiveTracking
from .tracker import Tracker as Tracker
