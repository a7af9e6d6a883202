# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of processes: start, first motion, memory."""
