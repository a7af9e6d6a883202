"""A node's life with, without and after its ROS master."""
