"""Hierarchical state machines in pure Python, API of SMACH."""
