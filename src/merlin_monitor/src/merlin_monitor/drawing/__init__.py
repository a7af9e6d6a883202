# SPDX-License-Identifier: Apache-2.0
"""State machines and plans as graphs, laid out by Graphviz."""
