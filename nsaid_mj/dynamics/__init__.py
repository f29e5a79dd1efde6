"""Compiled stages of a motion: one body, a tree, a tree with added mass. No Pinocchio."""
