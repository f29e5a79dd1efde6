"""The door of `robots`: what other houses may use."""

# The files that describe a vehicle.
from .assets import VehicleFiles as VehicleFiles

# The path of a file in a vehicle's asset folder, whether or not it exists.
from .assets import asset as asset

# Lines with the names of all robots, and how to get more.
from .assets import listed_robots as listed_robots

# A vehicle's published numbers, from its vehicle.toml; sources are in its SOURCE.md.
from .assets import published_numbers as published_numbers

# All scenario scripts by name.
from .assets import scenarios as scenarios

# A robot description that cannot be simulated.
from .errors import BadRobot as BadRobot

# Writes identified values: .urdf and .xml (MJCF) are models, .yaml is for `mujoco.sysid`.
from .export import write_model as write_model

# Raises what `load_robot_model` would if there is no such file or name.
from .files import check_model as check_model

# Whether a model to identify is a vehicle: the path of a sheet or its folder, or a name.
from .files import is_vehicle as is_vehicle

# The MJCF file of a model, by its path or of a packed robot by its name; None without one.
from .files import mjcf_of as mjcf_of

# The vehicles that have a folder in assets and a scenario of their own.
from .files import packed_vehicles as packed_vehicles

# The file that describes a robot, by its path or name; `others` are further names to suggest.
from .files import robot_file as robot_file

# Identified values of a tree of n joints, in SI units.
from .identified import Identified as Identified

# Shared parameters of two joints if the motor of one turns by v_i ± v_j.
from .identified import SharedFriction as SharedFriction

# A spring, counterweight or cable that pulls at a joint.
from .identified import Spring as Spring

# A copy of a model with other inertias: inertial (b, 10), ordered as `inertial_parameters`.
from .identified import with_inertias as with_inertias

# Reads a robot to simulate; errors in its file are raised, not corrected.
from .loading import load_robot as load_robot

# Reads a robot to identify: unphysical inertias are moved inside the cone, and reported.
from .loading import load_tree as load_tree

# The text of the file that `write_mjcf` writes; raises `InvalidInput` for a vehicle.
from .mjcf_export import mjcf_text as mjcf_text

# A user's MJCF, compiled.
from .mjcf_model import MjcfFile as MjcfFile

# The content of an MJCF for editing, with included files in their places.
from .mjcf_model import MjcfText as MjcfText

# A robot as its model file describes it: kinematics, and guesses of its parameters.
from .model import RobotModel as RobotModel

# Position servos on k joints: force = kp (u − q) − kv q̇.
from .model import Servos as Servos

# Meshes of a robot and their poses.
from .shapes import Looks as Looks

# A triangle mesh fixed to a body.
from .shapes import VisualMesh as VisualMesh

# Context in which MuJoCo's warnings are collected, not printed or written to MUJOCO_LOG.TXT.
from .silence import quiet as quiet

# Writes a table as YAML, lists of numbers on one line.
from .tables import write_table as write_table

# The actuators that act on a joint alone.
from .tree import actuators_of as actuators_of

# Overwrites the inertias of the bodies from `first` on with ten parameters each (10 b,).
from .tree import set_inertias as set_inertias

# Sets all plants' options: RK4 by dt [s], no automatic reset, no contacts, no joint limits.
from .tree import set_options as set_options

# MuJoCo's specification, with time step dt [s], of a Pinocchio model; no friction, no motors.
from .tree import tree_spec as tree_spec

# MuJoCo's quaternion (w, x, y, z) of a rotation matrix.
from .tree import wxyz as wxyz

# Checks a model file and the files that it names, before a library opens them; they count as read.
from .xml import check_named_files as check_named_files
