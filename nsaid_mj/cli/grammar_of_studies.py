"""The commands of `nsaid` that run a scenario many times, and their own options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

Switch = Annotated[bool, arg(help_behavior_hint="")]
"""A flag without a value, off by default."""

Folder = Annotated[Path | None, arg(metavar="FOLDER", help_behavior_hint="")]
"""A folder; its help states the default."""

File = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")]
"""A file, none by default."""

Files = Annotated[tuple[Path, ...], arg(metavar="FILE…", help_behavior_hint="")]
"""Files or folders, none by default."""

Model = Annotated[str | None, arg(metavar="FILE_OR_NAME", help_behavior_hint="")]
"""A model file, or the name of a packed robot or vehicle."""

Names = Annotated[str, arg(metavar="NAMES", help_behavior_hint="")]
"""Comma-separated names; none by default."""

Words = Annotated[str | None, arg(metavar="TEXT", help_behavior_hint="")]
"""Words or numbers; their help states the default."""

Number = Annotated[float | None, arg(metavar="NUMBER", help_behavior_hint="")]
"""A number; its help states the default."""

Count = Annotated[int | None, arg(metavar="COUNT", help_behavior_hint="")]
"""A whole number; its help states the default."""

ScenarioName = Annotated[
    Positional[str],
    arg(
        metavar="NAME_OR_FILE",
        help="a name from `nsaid list`, or the path of a script or scenario.json.",
    ),
]


@dataclass(frozen=True)
class Compare:
    """Compare identification methods on the logs of a scenario.

    All methods get the same logs and are evaluated by the same figures. Writes a table,
    compare.json, compare.csv and plots. The scenario's fields are flags too: `nsaid compare NAME
    --help`. `nsaid compare --log FILE… --models FILE… [--map FILE]` compares model files on a
    robot's own logs.

    Attributes:
        methods: comma-separated; by default all except sysid.
        seeds: such as 0,1,2 or 0:10.
        durations: comma-separated lengths of log [s]; by default half the duration, and all of it.
        sensors: ideal, noisy or ideal,noisy; by default those of the scenario.
        noise_scales: comma-separated multiples of the scenario's noise.
        budget: CPU time of the search by sysid [s].
        bound: also compute the Cramér–Rao bound of the noisy logs, and compare with it.
        out: folder of the results; by default runs/NAME-compare, numbered if that is taken.
        force: overwrite a finished study in the folder.
        quiet: print only errors.
        json: print only the table, as JSON, to the standard output.
    """

    methods: Words = None
    seeds: Annotated[str, arg(metavar="NUMBERS")] = "0:3"
    durations: Words = None
    sensors: Words = None
    noise_scales: Words = None
    budget: Number = None
    bound: Switch = False
    out: Folder = None
    force: Switch = False
    quiet: Switch = False
    json: Switch = False
    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class Sweep:
    """Run a scenario many times, with varied fields and seeds.

    Runs every combination of the varied fields with every seed, in parallel. An interrupted sweep
    is resumed by the same command. The scenario's fields are flags too (`nsaid sweep NAME --help`);
    --seed is the master seed that all others are drawn from.

    Attributes:
        vary: a field and its values, such as identifier.gain=0.1,1,10; repeat it for more fields.
        seeds: number of seeds drawn from the master seed.
        jobs: number of parallel runs; by default the number of processors.
        timeout: wall time after which a run counts as lost [s].
        engine: local (processes on this machine) or dask.
        address: address of the cluster's scheduler.
        retry: repeat lost runs.
        out: folder of the results; by default runs/NAME-sweep.
        json: print only medians and failures, as JSON.
        quiet: print only errors.
    """

    vary: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="FIELD=A,B,C")] = ()
    seeds: int = 10
    jobs: Count = None
    timeout: Number = None
    engine: Annotated[str, arg(metavar="WORD")] = "local"
    address: Words = None
    retry: Switch = False
    out: Folder = None
    json: Switch = False
    quiet: Switch = False
    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class MonteCarlo:
    """Identify from many priors, on one motion or many plants.

    Simulates first, then identifies in parallel threads, and prints quantiles of the final figures.
    An interrupted study is resumed by the same command. The scenario's fields are flags too
    (`nsaid montecarlo NAME --help`); --seed is the master seed that all others are drawn from.

    Attributes:
        runs: number of runs.
        jobs: number of parallel runs; by default the number of processors.
        own_plants: give every run its own plant, truth and motion; by default all share one.
        out: folder of the results; by default runs/NAME-montecarlo.
        json: print only quantiles, as JSON.
        quiet: print only errors.
    """

    runs: int = 256
    jobs: Count = None
    own_plants: Switch = False
    out: Folder = None
    json: Switch = False
    quiet: Switch = False
    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class Track:
    """Compare tracking laws on the same plants and references.

    Adaptive tracking with nullspace estimates, with the gains taken as known, with the identifier's
    estimate, and without adaptation. Writes a table, tracking.json, tracking.csv, a page and a
    recording. The scenario, such as track_ur5, is driven by AdaptiveTracking; its fields are flags
    too (`nsaid track NAME --help`).

    Attributes:
        laws: comma-separated: nullspace, conventional, computed_torque, composite; by default all.
        seeds: such as 0,1,2 or 0:10.
        out: folder of the results; by default runs/NAME-track, numbered if that is taken.
        force: overwrite a finished study in the folder.
        quiet: print only errors.
        json: print only the results, as JSON, to the standard output.
    """

    laws: Words = None
    seeds: Annotated[str, arg(metavar="NUMBERS")] = "0:10"
    out: Folder = None
    force: Switch = False
    quiet: Switch = False
    json: Switch = False
    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class Report:
    """Plot the distributions of a sweep on one page.

    Attributes:
        sweep: folder of the sweep, e.g. runs/ur5-sweep.
    """

    sweep: Positional[Path]


@dataclass(frozen=True)
class CompareModels:
    """Compare model files of an arm on its own logs.

    Every model is simulated in open loop from the commands, which are targets of position servos,
    or forces. Mean position errors over 0.2 s, 2 s and the whole log are compared with those of
    simple predictions: the delayed target, or a constant velocity.

    Attributes:
        log: log files or folders of them.
        models: files with the same joints; `identified` and `sysid` (MuJoCo's own toolbox, which
            takes minutes and starts at the first file) are fitted to the logs, of which each half
            is predicted from the other.
        map: TOML file with the meaning of columns.
        json: print only the scores of every joint, as JSON, to the standard output.
        quiet: print only errors.
    """

    log: Files = ()
    models: Annotated[tuple[str, ...], arg(metavar="FILE…", help_behavior_hint="")] = ()
    map: File = None
    json: Switch = False
    quiet: Switch = False
