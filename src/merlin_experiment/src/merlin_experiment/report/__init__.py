"""From tables of runs to the report: statistics, figures, text."""
