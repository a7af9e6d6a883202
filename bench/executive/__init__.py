# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of the executive layer: state machines, cancels and interruptions."""
