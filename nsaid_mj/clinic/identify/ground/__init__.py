"""A robot that stands and walks: its base moves, and forces that nobody measures act on its feet."""
