"""The paper's experiment: which runs, their statistics, the report."""
