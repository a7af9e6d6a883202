"""The plan dispatchers as components, and simulated actions."""
