"""Report on an identification: report.html and the summary on the terminal."""

from .report import brief_alarms as brief_alarms
from .report import page as page
from .report import print_identification as print_identification
from .report import write_report as write_report

__all__ = ["brief_alarms", "page", "print_identification", "write_report"]
