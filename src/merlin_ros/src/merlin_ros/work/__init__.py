"""What all work that runs for a client shares, without ROS."""
