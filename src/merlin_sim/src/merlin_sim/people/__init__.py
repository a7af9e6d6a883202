# SPDX-License-Identifier: Apache-2.0
"""The people of a world: how they walk, what they hear and what they answer."""
