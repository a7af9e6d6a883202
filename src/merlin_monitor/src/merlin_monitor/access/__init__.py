"""Access to the page: hosts, origins, operators and their tokens. Without ROS."""
