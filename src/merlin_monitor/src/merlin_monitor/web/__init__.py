# SPDX-License-Identifier: Apache-2.0
"""The page: its server, its live feed, and the control of the robot."""
