"""A mission of the home that is measured while it runs."""
