"""The nodes: bridges, the host of state machines, and the naive integration."""
