# SPDX-License-Identifier: Apache-2.0
"""The state of the robot in a terminal."""
