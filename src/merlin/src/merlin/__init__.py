"""Brings MERLIN up: launch files, PDDL, and the runner of applications."""
