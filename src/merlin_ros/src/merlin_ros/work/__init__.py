"""What all work that runs for somebody shares, without ROS."""
