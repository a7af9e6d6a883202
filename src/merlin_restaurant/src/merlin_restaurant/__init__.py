"""The SciRoc restaurant: a robot checks tables, serves orders and guides new clients."""
