"""Benchmarks of several robots in one plan."""
