# SPDX-License-Identifier: Apache-2.0
"""pytest fixtures: one action or one mission against simulated servers that a test scripts."""
