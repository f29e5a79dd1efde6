"""Recordings for the Rerun viewer: run.rrd of a finished run, and live streaming during a run.

Only this package imports rerun. `scene` draws the robot, `forces` the actuator forces, `series` the
curves; `layout` arranges them in the viewer. `file` writes a finished run, `live` streams a running
one, and `viewer` finds and starts Rerun's viewer.
"""

from .file import FILE as FILE
from .file import write as write
from .live import Live as Live
from .viewer import viewer_command as viewer_command
