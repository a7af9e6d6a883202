"""Records more than topics, and plays a recording again."""
