"""The home of the paper: its action, its task lists and its mission."""
