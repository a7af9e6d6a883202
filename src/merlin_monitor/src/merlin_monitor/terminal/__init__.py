"""The same state in a terminal."""
