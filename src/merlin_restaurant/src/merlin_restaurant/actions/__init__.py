# SPDX-License-Identifier: Apache-2.0
"""The PDDL actions of the restaurant domain as state machines."""
