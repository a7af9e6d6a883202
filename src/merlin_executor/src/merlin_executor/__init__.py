"""The Executor, its client and the Goal Dispatcher."""
