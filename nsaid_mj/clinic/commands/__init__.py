"""The commands of `nsaid` about a user's own robot: identify, inspect, live, compare --log."""
