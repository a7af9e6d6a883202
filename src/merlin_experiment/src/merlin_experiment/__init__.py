"""The experiment of the paper: missions that are measured, compared with an oracle, and reported."""
