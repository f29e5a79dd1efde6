"""The door of `plans`: what other houses may use."""

# Finds an excitation; equal arguments give equal bits.
from .excite.designing import design as design

# Everything known before an experiment.
from .excite.experiment import Experiment as Experiment

# The limits of an arm's model file, on a fixed base: position, velocity and effort.
from .excite.experiment import own_limits as own_limits

# The experiment with a robot, before it has a motion.
from .excite.experiment import scenario_of_model as scenario_of_model

# All figures of a design, for JSON.
from .excite.files import design_document as design_document

# The original scenario with the designed excitation, noisy sensors and the law `efficient`.
from .excite.files import scenario_of as scenario_of

# Writes motion, scenario and figures into a folder, made if need be; returns the files.
from .excite.files import write_design as write_design

# Measures the rank of motions with 1, 2, … harmonics, until P_⊥ is excited.
from .excite.information import ranks as ranks

# All limits of a motion.
from .excite.limits import Limits as Limits

# Reads a TOML file of limits, which replace the default ones.
from .excite.limits import read_limits as read_limits

# The page of a design in a folder; the arguments are those of `result_of`.
from .excite.page import design_page as design_page

# Predicts the results of a designed experiment, and of possible improvements.
from .excite.prediction import predict as predict

# Tries a design on a draw; None if `efficient` does not suit the scenario, or it fails.
from .excite.prediction import tried as tried

# TODO
from .excite.recording import DESIGN_RECORDING as DESIGN_RECORDING

# Writes a design's recording atomically, and returns its path, which ends in .rrd.
from .excite.recording import record_design as record_design

# TODO
from .studies.compare import BUDGET as BUDGET

# TODO
from .studies.compare import COMPARE_FILES as COMPARE_FILES

# The methods of a comparison and their logs.
from .studies.compare import comparison_plan as comparison_plan

# Runs a comparison, writes its files and plots, and prints its page; see `carried_out`.
from .studies.compare import run_comparison as run_comparison

# all but sysid, which takes minutes
from .studies.compare_report import DEFAULT as DEFAULT

# Executes runs in parallel.
from .studies.engine import Engine as Engine

# Reads a sweep's folder, of several rows of one run the last one.
from .studies.folder import read as read

# The runs of a Monte Carlo study: draws of a scenario whose own seed is the master seed.
from .studies.montecarlo import montecarlo_plan as montecarlo_plan

# The output of `nsaid montecarlo --json`.
from .studies.montecarlo_results import montecarlo_document as montecarlo_document

# The page of a study for the terminal.
from .studies.montecarlo_results import montecarlo_page as montecarlo_page

# The result of a study; a run is lost if it ended before the scenario's duration.
from .studies.montecarlo_results import montecarlo_result as montecarlo_result

# Executes the runs that are missing in a folder, and writes the files of a sweep.
from .studies.montecarlo_results import run_montecarlo as run_montecarlo

# The runs of a study, complete or interrupted.
from .studies.runs import Runs as Runs

# The path of the table, and the command for plots.
from .studies.sweep import files_of as files_of

# Executes the runs that are missing in a folder.
from .studies.sweep import run_sweep as run_sweep

# The output of `nsaid sweep --json`; numbers may be infinite.
from .studies.sweep import sweep_document as sweep_document

# The runs of a sweep.
from .studies.sweep import sweep_plan as sweep_plan

# The result of a sweep: the share of converged runs, and the distribution of its figures.
from .studies.sweep import sweep_result as sweep_result

# The page of a sweep, with the panels of these lines if there are any.
from .studies.sweep_report import sweep_page as sweep_page

# Writes a sweep's report.html and distributions.png, and returns their paths.
from .studies.sweep_report import write_sweep_page as write_sweep_page

# Runs a study, writes its files, page and recording, and prints the page.
from .track.run import run_tracking as run_tracking

# TODO
from .track.tracking import TRACKING_FILES as TRACKING_FILES

# The laws of a study, and the plants they control.
from .track.tracking import tracking_plan as tracking_plan
