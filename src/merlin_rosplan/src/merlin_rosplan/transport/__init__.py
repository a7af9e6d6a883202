"""How components serve, hand over, wait and publish."""
