# SPDX-License-Identifier: Apache-2.0
"""The PDDL actions of the home domain as state machines."""
