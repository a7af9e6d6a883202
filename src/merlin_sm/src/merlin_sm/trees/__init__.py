# SPDX-License-Identifier: Apache-2.0
"""Behaviour trees (py_trees) of MERLIN states; nothing else imports this package, nor py_trees."""
