"""What a recording keeps beside its topics, and how it is shown again."""
