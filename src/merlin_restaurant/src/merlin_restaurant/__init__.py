"""The SciRoc restaurant: the application and the people who play its guests."""
