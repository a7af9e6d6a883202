"""The components of the planning system, as ROS nodes."""
