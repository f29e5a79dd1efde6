"""Pages of an identification: report.html, and the summary on the terminal."""

from .report import brief as brief
from .report import page as page
