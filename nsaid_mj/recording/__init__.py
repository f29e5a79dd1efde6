"""A run to look at: run.rrd for the Rerun viewer, and the same while it runs.

This folder is the only importer of rerun. What is drawn is in `scene` (the robot) and `series`
(the curves), how it is arranged in `layout`; `file` writes a run that has ended, `live` streams
one that has not, `viewer` knows how to start Rerun's own program.
"""

from .file import FILE as FILE
from .file import write as write
from .live import Live as Live
from .viewer import viewer_command as viewer_command
