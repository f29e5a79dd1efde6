"""The door of `lab`: what other houses may use."""

# Tracks a persistent trajectory of all coordinates, with or without adaptation.
from .control.adaptive.tracker import AdaptiveTracking as AdaptiveTracking

# Tracks a reference under one of the laws; an informed one asks for θ̂ every `period` [s].
from .control.adaptive.tracker import Tracker as Tracker

# A controller: computes the command from time and measured state.
from .control.driver import Driver as Driver

# A driver's parameters, as part of a scenario; `build` makes the driver.
from .control.driver import DriverConfig as DriverConfig

# A finite Fourier series for every joint.
from .control.signals import Series as Series

# A driver with given frequencies and phases in place of its random ones.
from .control.tracking import DesignedSignals as DesignedSignals

# Every joint tracks a given finite Fourier series, centre + Σ (a_k sin kωt + b_k cos kωt).
from .control.tracking import DesignedTracking as DesignedTracking

# Every joint tracks a random finite Fourier series; passive ones swing freely.
from .control.tracking import FourierTracking as FourierTracking

# half width of a 95 % interval of the normal distribution [standard deviations]
from .evaluation.confidence import INTERVAL as INTERVAL

# Computes the figures of estimates of one plant, from any method.
from .evaluation.figures import Judge as Judge

# Prints the verdict on a run, the figures behind it, and the paths of its files.
from .evaluation.page import print_result as print_result

# Evaluates a run, completed or not; `curves.with_curves` adds what is drawn.
from .evaluation.run_evaluation import evaluate as evaluate

# Versions of this package, Python and the dependencies that a run's numbers depend on.
from .evaluation.run_evaluation import versions as versions

# The misfit at the end of a run's log; None where `filter_of` is, or rows are missing.
from .evaluation.run_misfit import misfit_of as misfit_of

# The result of a run; `summary.summary_of` writes it as summary.json.
from .evaluation.run_result import RunResult as RunResult

# Judges the motion so far whenever it is half as long again, as `misfit_of` does at its end.
from .evaluation.running import RunningMisfit as RunningMisfit

# The true parameters of a simulated plant, and the true set.
from .evaluation.truth import Truth as Truth

# The result of a check of the paper's statements on a run.
from .evaluation.verify import Verification as Verification

# Where a command writes its results.
from .folders import ResultsFolder as ResultsFolder

# An identifier and its state along a log, whose first measurement initializes it.
from .following import Following as Following

# Loads a scenario by the name of a packaged one, or from a script.
from .library import load as load

# The error to raise for an exception in a user's code.
from .library import script_error as script_error

# A finished run: measurements and estimates, without any true value.
from .loop import Run as Run

# A finished run of a simulated plant, whose truth can be read.
from .loop import SimulatedRun as SimulatedRun

# Runs identifiers on the measurements of a source until it ends, and writes the record.
from .loop import followed as followed

# The scenario's own identifier, for a robot that is not simulated.
from .loop import measured_identifiers as measured_identifiers

# Runs a scenario: simulates the plant, runs the identifiers, writes the record.
from .loop import run as run

# Callbacks during a run, for a progress bar or a live viewer.
from .observer import Observer as Observer

# The structure, prior and meshes of a robot, without true values.
from .observer import RobotDescription as RobotDescription

# The flags of a scenario, whose defaults are the values in its script.
from .options import ScenarioFlags as ScenarioFlags

# A link's size [m]: its radius of gyration about the joint.
from .plants.arm import extent as extent

# The plants made from a vehicle's TOML file, without special cases of others.
from .plants.families import vehicle_families as vehicle_families

# A robot with a motor or servo on every joint; a floating base is fixed to a stand.
from .plants.jointed import ArmPlant as ArmPlant

# `mujoco.sysid`, MuJoCo's own toolbox.
from .plants.sysid import Toolbox as Toolbox

# A vehicle of one body, made from a data sheet.
from .plants.world.blueprint import VehiclePlant as VehiclePlant

# A plant that can be made with any physical θ of its system.
from .plants.world.config import ParametricPlantConfig as ParametricPlantConfig

# A plant's parameters, as part of a scenario; `build` makes the plant.
from .plants.world.config import PlantConfig as PlantConfig

# Collision detection for a robot on a fixed base, within ranges (n,), (n,) of coordinates.
from .plants.world.contacts import Contacts as Contacts

# Maps position numbers and velocities to and from MuJoCo's qpos and qvel, by joint name.
from .plants.world.coordinates import JointMap as JointMap

# Noise levels of a position encoder and of a velocity sensor.
from .plants.world.noise import SensorNoise as SensorNoise

# A simulated plant. Step it inside `with plant.running():`.
from .plants.world.plant import Plant as Plant

# Sensors with their own stream of random errors; without noise they are exact.
from .plants.world.sensors import Sensors as Sensors

# Evaluates a run and writes summary.json, scenario.json, run.rrd and report.html.
from .postprocessing import finish as finish

# Post-processes a run, such as one that was killed, from its record alone.
from .postprocessing import rebuild as rebuild

# One transient line on the terminal for a whole command.
from .progress import Progress as Progress

# Shows a transient bar of a study on the standard error; `done` is the format of its count.
from .progress import counted as counted

# The record of a run, read from its file.
from .record import Record as Record

# Streams a run into a viewer window, or to a browser if there is no display.
from .recording.live import LiveRecording as LiveRecording

# The command line that opens a recording, or with `web` serves it to a local browser.
from .recording.viewer import viewer_command as viewer_command

# A complete experiment. Equal scenarios give records that are identical to the bit.
from .scenario import Scenario as Scenario

# Independent random streams of one seed; appending a stream leaves the others unchanged.
from .setup import Seeds as Seeds

# A scenario's plant and prior, and builders of its driver, sensors and identifiers.
from .setup import Setup as Setup

# Provides the measurements of a run, segment by segment.
from .source import Source as Source

# Consecutive measurements from a source.
from .source import SourceSegment as SourceSegment

# (N, k) what servos follow of targets, as means over the time to the next row.
from .target_profile import followed_targets as followed_targets
