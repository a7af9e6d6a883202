# SPDX-License-Identifier: Apache-2.0
"""The parts that all benchmarks share: figures, budgets, the speed of the machine, processes of ROS."""
