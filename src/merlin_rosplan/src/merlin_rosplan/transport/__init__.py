# SPDX-License-Identifier: Apache-2.0
"""How components serve, hand over, wait and publish."""
