"""What action interfaces and hosts decide. Without ROS."""
