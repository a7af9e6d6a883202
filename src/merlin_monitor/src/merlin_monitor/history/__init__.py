"""The file of the history, without ROS: events, and what was shown at any moment."""
