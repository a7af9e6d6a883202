"""Simulated worlds, robot, navigation and speech."""
