from .tracker import AdaptiveTracking as AdaptiveTracking
from .tracker import Tracker as Tracker
