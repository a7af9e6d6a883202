"""The parts of the dispatch client: the book of one dispatch, the kinds of dispatchers, owners, replies."""
