"""A robot of the fleet over ROS."""
