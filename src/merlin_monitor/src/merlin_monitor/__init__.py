"""One page that shows what the robot knows, plans and does."""
