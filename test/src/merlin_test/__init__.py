"""What the suites of several folders share."""
