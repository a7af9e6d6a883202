# SPDX-License-Identifier: Apache-2.0
"""Guests and barman of the simulated restaurant. The robot knows nothing of this package."""
