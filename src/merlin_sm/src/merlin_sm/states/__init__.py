"""The ready states of :class:`merlin_sm.state_factory.MerlinStateFactory`."""
