"""Adaptive tracking control with nullspace estimates, and the laws it is compared with."""

from .tracker import AdaptiveTracking as AdaptiveTracking
from .tracker import Tracker as Tracker
