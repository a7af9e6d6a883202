"""What happened in a trial, in the order of time, and what must not have happened."""
