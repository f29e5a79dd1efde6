"""Small compiled mathematics: linear algebra, rotations and poses. No robotics."""
