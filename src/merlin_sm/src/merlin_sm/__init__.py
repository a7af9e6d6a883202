"""State machines that know the planning system."""
