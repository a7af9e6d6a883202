# SPDX-License-Identifier: Apache-2.0
"""Answers about the execution of plans, now and before, from the monitor's history."""
