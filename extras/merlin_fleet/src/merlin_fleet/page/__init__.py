# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet, for any machine that reaches the hub: without a robot, and without a master."""
