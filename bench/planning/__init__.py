# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of the planning system: knowledge, planning, dispatch, engines."""
