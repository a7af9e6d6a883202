# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of the reactive layer: driving, the velocity guard."""
