"""State machines and plans as graphs, laid out by Graphviz."""
