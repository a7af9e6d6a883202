"""The node /merlin_sim: the simulation behind topics and services."""
