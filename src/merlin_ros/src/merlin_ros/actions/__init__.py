"""Action servers and clients whose goals are leased."""
