"""The process in which a planning runs, and its end; no ROS."""
