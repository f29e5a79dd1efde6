"""The law with a memory of past data."""
