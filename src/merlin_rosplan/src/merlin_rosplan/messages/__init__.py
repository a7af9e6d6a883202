"""ROSPlan's messages to and from the pure classes."""
