"""Report on an identification: report.html and the summary on the terminal."""

from .report import FILE as FILE
from .report import page as page
from .report import write as write_report
from .terminal import print_findings as print_findings
from .terminal import print_identification as print_identification

__all__ = ["FILE", "page", "print_findings", "print_identification", "write_report"]
