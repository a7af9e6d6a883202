"""The protocol of the fleet: events in, decisions out. Without ROS and without network."""
