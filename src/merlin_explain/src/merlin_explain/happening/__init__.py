# SPDX-License-Identifier: Apache-2.0
"""Answers about what happens and has happened, from the monitor's history."""
