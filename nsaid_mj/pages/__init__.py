"""Reports on runs: HTML pages, plots, the terminal summary, progress while a command runs."""
