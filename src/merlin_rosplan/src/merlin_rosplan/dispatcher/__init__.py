# SPDX-License-Identifier: Apache-2.0
"""The plan dispatchers as components, and simulated actions."""
