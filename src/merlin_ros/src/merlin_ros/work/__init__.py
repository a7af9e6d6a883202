"""What watchers and servers of all kinds share. Without ROS."""
