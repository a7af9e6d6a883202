"""What is followed over ROS: each listener hands messages to the model."""
