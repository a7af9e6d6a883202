"""The knowledge base's state and its changes; no ROS."""
