"""PDDL read, evaluated and written; no ROS."""
