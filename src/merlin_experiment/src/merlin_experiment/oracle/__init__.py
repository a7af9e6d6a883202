"""The best that a robot could do: the yardstick of the experiment."""
