"""pytest fixtures: one action or one mission against simulated servers that a test scripts."""
