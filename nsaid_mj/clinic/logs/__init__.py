"""From log files to `Recordings`: reading, mapping to joints, preparation; `stream` for live ones.

mapping = read_map("map.toml")  # or None, to match columns by name
tables = read_tables(["log.csv"], mapping)
recordings = checked(prepare(tables, mapping, robot), robot)

The names are listed in `__init__.pyi`; each is imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
