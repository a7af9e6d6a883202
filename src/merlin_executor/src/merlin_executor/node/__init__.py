"""The Executor as a node: carries the decisions of `core` out over ROS."""
