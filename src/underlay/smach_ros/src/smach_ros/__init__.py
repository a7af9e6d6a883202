"""SMACH states and introspection for ROS."""
