"""A simulated store, for tests and benchmarks without a hub."""
