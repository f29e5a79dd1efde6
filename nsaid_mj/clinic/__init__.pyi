"""The door of `clinic`: what other houses may use."""

# How well a model predicts logs.
from .identify.comparison import Score as Score

# Scores of models on logs of an arm driven by force, the last that of a constant velocity.
from .identify.comparison import compare_arms as compare_arms

# Scores of models on logs of a servo arm, the last that of its delayed target.
from .identify.comparison import compare_servos as compare_servos

# Writes the calibrated model, in all formats that can represent it, into an existing folder.
from .identify.export import write_models as write_models

# Pairs (i, j, ±1) of joints that a map couples: a motor turns by the sum or the difference.
from .identify.identify import coupled as coupled

# The logs and the map, by default a packed robot's; raises `InvalidInput` without a log.
from .identify.identify import files_of as files_of

# Identifies a robot from logs whose commands are forces, in any unit; see `identify`.
from .identify.identify import identify_forces as identify_forces

# Prepared and checked logs of a robot.
from .identify.identify import recordings_of as recordings_of

# An arm of position servos and its logs of targets; None of any other robot or logs.
from .identify.identify import servos_of as servos_of

# The result of inspecting a log.
from .identify.inspection import Inspection as Inspection

# Computes figures of every channel of a log and, given a robot, runs the checks of `identify`.
from .identify.inspection import inspect as inspect

# Draws q, v and u of every joint over time, or all channels if they are not matched, as PNG.
from .identify.inspection_page import draw_inspection as draw_inspection

# Prints whether the log can be identified, a line for each channel, then the findings.
from .identify.inspection_page import print_inspection as print_inspection

# A load as the command line states it, such as `loaded.csv:0.25kg@gripper`.
from .identify.loads import load_of as load_of

# A robot whose measurements arrive while it moves.
from .identify.measured import LiveRobot as LiveRobot

# The scenario of a run on measurements from outside, without the samples.
from .identify.measured import measured_scenario as measured_scenario

# Reads a robot's model from a URDF, MJCF or TOML file, or finds it by name.
from .identify.models import load_robot_model as load_robot_model

# The plant of the family to which a vehicle's TOML file belongs.
from .identify.models import plant_of as plant_of

# The page of an identification; without a `command` line it names model and logs only.
from .identify.page import identification_page as identification_page

# Writes a recording of the training logs, atomically, and returns its path.
from .identify.recording import record as record

# Writes a recording of the logs and their replay, atomically, and returns its path.
from .identify.recording import record_servos as record_servos

# Result of `identify`.
from .identify.result import Identification as Identification

# How the structure is chosen.
from .identify.result import Options as Options

# The map of a log as TOML: entries that channels' names imply, and lines to fill in.
from .logs.first_map import first_map as first_map

# The log files of a folder, ordered by name; a log that is a folder is one.
from .logs.formats import files as files

# The format of a log file, or of a folder that is a log, by its first bytes.
from .logs.formats import form_of as form_of

# Context that limits every unpacked file to `size` bytes; `InvalidInput` unless size > 0.
from .logs.formats import limited_to as limited_to

# Reads map.toml.
from .logs.mapping import read_map as read_map

# A UDP socket that listens on this machine only; `InvalidInput` if the port is not free.
from .logs.stream import bound as bound

# Reads log files, and those of folders; the map may state their time column, unit or rate.
from .logs.tables import read_tables as read_tables

# A model and log from which nothing can be identified.
from .logs.unusable import UnusableLog as UnusableLog

# Deviation of MuJoCo from logs with the exported file at a path, and with the user's own.
from .servos.export import replayed as replayed

# Writes the model's own MJCF with the servos of a result; nothing else is changed.
from .servos.export import write_servo_mjcf as write_servo_mjcf

# Checks that no option of logs of forces was given with logs of targets.
from .servos.identify import check_servo_options as check_servo_options

# Identifies stiffness, damping, friction, armature and delay of every servo by output error.
from .servos.identify import identify_servos as identify_servos

# Reads an arm and its logs; None if it is no MJCF with servos, or the logs hold no targets.
from .servos.identify import servo_logs as servo_logs

# An arm with position servos, and logs of their targets.
from .servos.logs import ServoLogs as ServoLogs

# The errors of models on logs, as means over all joints in a unit of 1/1000.
from .servos.page import scores_page as scores_page

# The page of identified servos.
from .servos.page import servo_page as servo_page

# The estimate at a sample.
from .session import LiveEstimate as LiveEstimate

# A live identification before its first sample.
from .session import Session as Session
