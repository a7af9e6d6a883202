"""Benchmarks of the monitor: page, clients, history."""
