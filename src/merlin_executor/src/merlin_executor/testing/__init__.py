"""Tools that put an Executor and everything below it under stress, for our suites and for users' own."""
