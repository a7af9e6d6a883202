"""Benchmarks of the reactive layer: driving, the velocity guard."""
