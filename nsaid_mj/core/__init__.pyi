"""The door of `core`: what other houses may use."""

# Uncertainty of an estimate.
from .laws.base import Confidence as Confidence

# An identifier's outputs along a log, one row for each of N measurements.
from .laws.base import Estimates as Estimates

# An adaptive identifier of a system's θ: pure, bitwise reproducible functions of a state.
from .laws.base import Identifier as Identifier

# The complete state of an identifier.
from .laws.base import State as State

# How a run ended, in words, with the remedy.
from .laws.base import Status as Status

# ∇²ψ(θ̂) = Γ⁻¹ + μ ∇²b(θ̂) in place of Γ⁻¹.
from .laws.cone.law import ConeMetric as ConeMetric

# Parameters that are known up to about ±error, inside the cone of physical ones.
from .laws.cone.prior import Prior as Prior

# The configuration of an identifier; `build` makes the identifier.
from .laws.config import IdentifierConfig as IdentifierConfig

# Nullspace adaptive identification with constant gains.
from .laws.config import NullspaceAID as NullspaceAID

# Adaptive identification with parameters assumed known.
from .laws.conventional import ConventionalAID as ConventionalAID

# An extended Kalman filter of (q, v, θ), for measurements dt [s] apart; see `kalman`.
from .laws.efficient.estimator import KalmanFilter as KalmanFilter

# A log followed by the filter alone.
from .laws.efficient.estimator import Replay as Replay

# State of the filter at a sample. All arrays are overwritten by `follow_filter`.
from .laws.efficient.filter import FilterState as FilterState

# Differences between the acting and the recorded signals of actuators and sensors.
from .laws.efficient.signals import Signals as Signals

# State of the efficient law: the filter, the memory that guards it, and their supervision.
from .laws.efficient.state import EfficientState as EfficientState

# A fault that was detected and isolated.
from .laws.faults import FaultEvent as FaultEvent

# The paper's metric: θ̂̇ = Γ Wᵀ Δv with a constant Γ.
from .laws.metric import ConstantMetric as ConstantMetric

# The map from Wᵀ Δv to θ̂̇.
from .laws.metric import Metric as Metric

# (44) and (45), integrated by RK4 between measurements, the command held.
from .laws.nullspace_aid import NullspaceIdentifier as NullspaceIdentifier

# Measurements and commands of N samples, in order of time, checked when the log is made.
from .log import Log as Log

# One sample in the system's own coordinates: the only input of an identifier.
from .log import Measurement as Measurement

# Assumed standard deviations of the sensors' noise, white from sample to sample.
from .log import SensorLevels as SensorLevels

# Levels of (2) and (75) during a run, from the identifier's own regressor.
from .nullspace.persistence import PersistenceMonitor as PersistenceMonitor

# A split of θ/scale space into P_s(θ) and its orthogonal complement (32–36).
from .nullspace.subspace import Nullspace as Nullspace

# Marks a function that Python calls, or several compiled ones; see `Kernel`.
from .numerics.kernels import kernel as kernel

# Marks a larger function, which need not become part of every function that calls it.
from .numerics.kernels import routine as routine

# Overwrites b in x (n,) with M⁻¹ b, reading M's lower triangle; returns the smallest pivot.
from .numerics.linalg import solve_positive as solve_positive

# An FIR filter without a phase, with half amplitude at a cut-off.
from .numerics.low_pass import LowPass as LowPass

# A Butterworth filter of x (N, ...) along the first axis, forward and backward.
from .numerics.low_pass import zero_phase as zero_phase

# (N,) signs, 1 or −1, with which quaternions (N, 4) are continuous in time.
from .numerics.spatial import continuous_signs as continuous_signs

# a × b of two (3,) vectors.
from .numerics.spatial import cross as cross

# (4,) the quaternion product one ⊗ other, normalised.
from .numerics.spatial import product as product

# (4,) unit quaternion (x, y, z, w) of a rotation vector (3,) [rad].
from .numerics.spatial import quaternion_of as quaternion_of

# (3,) a vector in world axes, from its components in body axes (3,).
from .numerics.spatial import rotate as rotate

# (3, 3) matrix, body to world, of a unit quaternion (x, y, z, w).
from .numerics.spatial import rotation as rotation

# (3,) rotation vector [rad], at most π long, of a unit quaternion (x, y, z, w).
from .numerics.spatial import rotation_vector as rotation_vector

# (3,) a vector in body axes, from its components in world axes (3,).
from .numerics.spatial import unrotate as unrotate

# What stands for a number that there is not.
from .parameters import ABSENT as ABSENT

# An array of float64; shapes and units are in the docstrings.
from .parameters import Array as Array

# Consecutive parameters of one kind.
from .parameters import Block as Block

# The set that a block of parameters lies in: free, positive, an inertia, a mass matrix.
from .parameters import Geometry as Geometry

# An array of whole numbers, as of indices.
from .parameters import Indices as Indices

# The space of θ (p,): blocks in order.
from .parameters import ParameterSpace as ParameterSpace

# A number with so many digits, or rounded to a quantum: 0.031, −12.5, 3.2·10⁻⁵.
from .parameters import number as number

# Joins labels, grouped by the part they belong to.
from .parameters import phrase as phrase

# A number in few digits, a power of ten only below 1e-4 and from 1e5: 0.00021, 1.8·10⁻⁶.
from .parameters import rounded as rounded

# The blocks of θ that are cones, for compiled code, with their matrices P(θ) sparse.
from .quotient.cone import Cone as Cone

# J(θ) = ½ Σ_i N_i log λ_i(θ) + the prior, the negative logarithm of a density.
from .quotient.cost import Posterior as Posterior

# R of some Gramians.
from .quotient.cost import Quotient as Quotient

# Gramians that add over parts of a log.
from .quotient.gramians import Sums as Sums

# The type of `Acting` in signatures of compiled functions.
from .structure.acting import ACTING as ACTING

# A structure at some θ, and the workspace of `act`: flat, as one part of a plant's memory.
from .structure.acting import Acting as Acting

# Writes the generalised forces F θ − C v (n,), and the lower triangle of M into work.M.
from .structure.acting import act as act

# Adds the forces of columns on joints to force (n,).
from .structure.acting import act_on_joints as act_on_joints

# Acceleration of gravity [m/s²], known: weight is a column of the mass.
from .structure.blocks import GRAVITY as GRAVITY

# A block of θ, and the columns of F that it scales.
from .structure.blocks import Term as Term

# All kinds of columns, by name.
from .structure.columns import KINDS as KINDS

# A kind of column of F.
from .structure.columns.kind import Kind as Kind

# E with E Jᵀ = 0 and λ̂ of contacts at N samples: E W θ = 0 for every force of contact.
from .structure.contacts import Elimination as Elimination

# The type of `InverseDynamics` in signatures of compiled functions.
from .structure.inverse_dynamics import INVERSE_DYNAMICS as INVERSE_DYNAMICS

# An arm's structure and the workspace of `write_required_force`, which calls overwrite.
from .structure.inverse_dynamics import InverseDynamics as InverseDynamics

# Writes the force (n,) of computed torque along a desired motion of an arm.
from .structure.inverse_dynamics import write_tracking_force as write_tracking_force

# Data-sheet guesses for the b bodies and k joints of a robot.
from .structure.joints import JointScales as JointScales

# M(q, θ) v̇ + C(x, θ) v = −g(q, θ) − f(v, θ) + diag(k) u (5): motors on a tree's 1-DOF joints.
from .structure.joints import JointTree as JointTree

# Writes the rotation matrix (9), body to world, of the unit quaternion (x, y, z, w) q[at].
from .structure.kinematics import write_rotation as write_rotation

# One term of F θ: a force of known direction and unknown size.
from .structure.parts import Column as Column

# Where a body touches its surroundings.
from .structure.parts import ContactPoint as ContactPoint

# A part of a body's 6×6 inertia about its origin, in its axes, linear in θ.
from .structure.parts import Inertia as Inertia

# A vehicle's ranges of operation, from which random probes of its structure are drawn.
from .structure.parts import Operation as Operation

# Inertia that turns or slides with a joint alone: a motor's rotor.
from .structure.parts import Rotor as Rotor

# M ν̇ + C(ν) ν = F θ (4) of one body in space, in the plane, or along the vertical.
from .structure.single_body import SingleBody as SingleBody

# M(x, θ) v̇ + C(x, θ) v = F(t, x, u) θ (4), linear in θ (8, 9), with Ṁ − 2C skew.
from .structure.system import SecondOrderSystem as SecondOrderSystem
