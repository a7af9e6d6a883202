"""The ports of a node: they stay open, and the node ends when they do not."""
