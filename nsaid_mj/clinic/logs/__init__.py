"""From log files to `Recordings`: reading, mapping to joints, preparation; `stream` for live ones.

mapping = read_map("map.toml")  # or None, to match columns by name
tables = read_tables(["log.csv"], mapping)
recordings = checked(prepare(tables, mapping, robot), robot)
"""
