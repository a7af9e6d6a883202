"""The commands `fleet` and `keys`."""
