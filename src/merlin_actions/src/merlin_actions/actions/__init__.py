"""Actions that are ready to use in any application."""
