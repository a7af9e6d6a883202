"""Benchmarks of the planning system: knowledge, planning, dispatch, engines."""
