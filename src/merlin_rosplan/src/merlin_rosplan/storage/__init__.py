"""The knowledge base's file; no ROS."""
