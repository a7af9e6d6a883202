"""Whether PDDL and plans are right, with kairos where it is installed."""
