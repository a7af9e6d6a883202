"""Planners: engines, commands, their output; no ROS."""
