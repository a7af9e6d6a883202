# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of several robots in one plan."""
