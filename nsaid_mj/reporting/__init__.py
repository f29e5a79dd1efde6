"""What a person reads of a run: pages, plots, the terminal, progress."""
