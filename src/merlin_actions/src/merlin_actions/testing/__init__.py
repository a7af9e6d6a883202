# SPDX-License-Identifier: Apache-2.0
"""Simulated action servers for tests: real ROS processes with seeded delays, failures, hangs and crashes."""
