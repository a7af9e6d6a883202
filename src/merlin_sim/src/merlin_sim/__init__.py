"""The simulator: worlds, robots, their sensors, people and time."""
