"""The home missions and the experiment of the paper."""
