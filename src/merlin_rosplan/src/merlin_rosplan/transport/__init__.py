"""How components serve, hand over, wait and tell."""
