# SPDX-License-Identifier: Apache-2.0
"""Brings MERLIN up: launch files, PDDL, and the runner of applications."""
