"""The transport that every MERLIN node uses."""
