"""What is done with many runs, or before one: excitation, tracking, studies."""
