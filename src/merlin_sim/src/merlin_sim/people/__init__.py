"""The people of a world: how they walk, what they hear and what they answer."""
