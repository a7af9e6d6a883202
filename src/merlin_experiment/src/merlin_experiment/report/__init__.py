# SPDX-License-Identifier: Apache-2.0
"""From tables of runs to the report: statistics, figures, text."""
