"""Who may ask the page for what: hosts, origins, operators and their tokens. Without ROS."""
