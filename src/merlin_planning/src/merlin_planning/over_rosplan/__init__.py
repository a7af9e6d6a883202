"""What a client does itself at a dispatcher of the original ROSPlan."""
