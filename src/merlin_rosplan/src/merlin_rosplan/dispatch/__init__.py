"""Plan graphs and what is dispatched when; no ROS."""
