# SPDX-License-Identifier: Apache-2.0
"""The world on paper: its model, its file, its map. Knows no ROS and no physics."""
