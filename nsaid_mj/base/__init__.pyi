"""The door of `base`: what other houses may use."""

# Base of all configurations.
# Upper bound of physical quantities in SI units; its fourth power is far below overflow.
from .bounds import LARGEST as LARGEST
from .bounds import Config as Config

# A finite number ≥ 0.
from .bounds import NonNegative as NonNegative

# A finite number.
from .bounds import Number as Number

# A finite number > 0.
from .bounds import Positive as Positive

# A number > 0 and ≤ 1.
from .bounds import PositiveShare as PositiveShare

# Decorator: a frozen dataclass whose fields are checked against their annotations.
from .bounds import config as config

# A copy of JSON-like data in which NaN and infinities are None, for strict JSON.
from .bounds import without_nonfinite as without_nonfinite

# Words by what they choose.
from .choices import CHOICES as CHOICES

# The comma-separated numbers of a flag's text; raises `InvalidInput` if it has others.
from .choices import numbers_in as numbers_in

# The attributes of a package whose stub lists its names; each is imported on first use.
from .doors import door as door

# A run folder or file that cannot be read.
from .errors import BadRun as BadRun

# Two engines compute different dynamics for the same robot.
from .errors import EnginesDisagree as EnginesDisagree

# A folder into which another process, or another thread of this one, is writing.
from .errors import FolderInUse as FolderInUse

# A value that cannot be used.
from .errors import InvalidInput as InvalidInput

# A method found no estimate on a log.
from .errors import NoEstimate as NoEstimate

# A file that cannot be written: the disk is full, or its folder is gone or read-only.
from .errors import NotWritten as NotWritten

# Root of all errors raised on purpose by nsaid_mj.
from .errors import NsaidError as NsaidError

# A name that does not exist, with similar names that do.
from .errors import UnknownName as UnknownName

# A text with U+FFFD for each control character, such as the escape that steers a terminal.
from .errors import printable as printable

# A file that this package writes: only in place of one of ours, which it signs.
from .files import OutputFile as OutputFile

# A folder that a command writes its results into.
from .files import OutputFolder as OutputFolder

# The value of a JSON text; raises `ValueError` if it is not JSON, or nested too deeply.
from .files import json_of as json_of

# Prints a value as strict JSON; numbers that are not finite become null.
from .files import print_json as print_json

# A finding about the input, for the user.
from .findings import Finding as Finding

# A file of the user's, which no command that reads it replaces.
from .inputs import InputFile as InputFile

# A path with the home directory in place of a leading `~`, if there is such a user.
from .inputs import path_of as path_of

# A command's options with the home directory in place of every leading `~`.
from .inputs import with_homes as with_homes

# Whether a package can be imported.
from .optional import installed as installed

# Pinocchio, imported on first use; its absence is a `MissingPackage`.
from .optional import pin as pin

# Imports a package that an extra installs; `purpose` says what needs it.
from .optional import require as require

# The time since it was made. It stops while the thread that reads it compiles kernels.
from .stopwatch import Stopwatch as Stopwatch

# Decorator of functions during which BLAS and OpenMP use a single thread.
from .threads import single_threaded as single_threaded
