"""A robot that stands and walks: its base moves, and unmeasured forces act on its feet."""
