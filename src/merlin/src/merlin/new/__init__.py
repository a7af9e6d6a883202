"""Writes the package of a new application: `rosrun merlin new`. Without ROS."""
