# SPDX-License-Identifier: Apache-2.0
"""The ports of a node: they stay open, and the node ends when they do not."""
