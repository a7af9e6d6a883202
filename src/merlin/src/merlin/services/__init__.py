"""Writes the systemd services of a robot's computer."""
