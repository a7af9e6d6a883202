"""MERLIN actions: state machines that a planning system dispatches."""
