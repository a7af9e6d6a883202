# SPDX-License-Identifier: Apache-2.0
"""The home of the paper: its action, its task lists and its mission."""
