"""Pages of an identification, of forces or of position servos."""

from .report import page as page
