"""Benchmarks of the executive layer: state machines, cancels and interruptions."""
