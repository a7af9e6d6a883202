"""The PDDL actions of the home domain as state machines."""
