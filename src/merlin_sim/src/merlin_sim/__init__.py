# SPDX-License-Identifier: Apache-2.0
"""The simulator: worlds, robots, their sensors, people and time."""
