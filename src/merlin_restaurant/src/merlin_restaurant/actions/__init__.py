"""The PDDL actions of the restaurant domain as state machines."""
