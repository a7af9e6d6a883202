"""Benchmarks of processes: start, first motion, memory."""
