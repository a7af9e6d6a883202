# SPDX-License-Identifier: Apache-2.0
"""The nodes: bridges, the host of state machines, and the naive integration."""
