# SPDX-License-Identifier: Apache-2.0
"""The node /merlin_sim: the simulation behind topics and services."""
