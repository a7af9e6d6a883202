"""State machines that know the planning system, and the transport that everything in MERLIN uses."""
