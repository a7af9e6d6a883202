"""What is done to a system: one stroke per kind of fault."""
