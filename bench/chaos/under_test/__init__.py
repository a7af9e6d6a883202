"""The system under test: its processes, its network, its witnesses and its client."""
