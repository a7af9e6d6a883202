"""The state of the robot in a terminal."""
