"""Position servos from logs of (target, position), without torque: the law "output error".

given = servo_logs("arm.xml", ["log.csv"])  # None if the logs hold no targets
result = identify_servos(given)
write_servo_mjcf(result, Path("identified.xml"))
"""

from .export import replayed as replayed
from .export import rollout as rollout
from .export import with_replay as with_replay
from .export import write_servo_mjcf as write_servo_mjcf
from .identify import identify_servos as identify_servos
from .identify import read_servos as read_servos
from .identify import servo_logs as servo_logs
from .logs import ServoLog as ServoLog
from .logs import ServoLogs as ServoLogs
from .words import Replayed as Replayed
from .words import ServoIdentification as ServoIdentification
