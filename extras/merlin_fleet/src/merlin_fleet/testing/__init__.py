"""A simulated store, for tests without a hub."""
