"""What rviz shows of MERLIN, and the goals that are clicked there."""
