"""The planning system: ROSPlan's node interfaces over a core without ROS."""
