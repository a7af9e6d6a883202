"""What things look like, and the process that makes pictures of them. Knows no ROS."""
