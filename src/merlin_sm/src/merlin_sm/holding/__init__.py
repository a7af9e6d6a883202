"""Holds state machines before states, as operators ask for it."""
