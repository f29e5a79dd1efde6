"""From log files to `Recordings`: reading, mapping to joints, preparation; `stream` for live ones.

mapping = read_map("map.toml")  # or None, to match columns by name
tables = read_tables(["log.csv"], mapping)
recordings = checked(prepare(tables, mapping, robot), robot)
"""

from .checks import checked as checked
from .checks import checks as checks
from .formats import limited_to as limited_to
from .mapping import Map as Map
from .mapping import map_of as map_of
from .mapping import read_map as read_map
from .preparation import prepare as prepare
from .tables import Table as Table
from .tables import read_tables as read_tables
