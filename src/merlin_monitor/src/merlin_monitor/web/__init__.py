"""The page: its server, its live feed, and the control of the robot."""
