"""The result of a command, and how pages, terminal and recordings show it."""
