# SPDX-License-Identifier: Apache-2.0
"""A fleet on one machine: robots in network namespaces, links that are cut, robots that are killed."""
