# SPDX-License-Identifier: Apache-2.0
"""The experiment of the paper: missions that are measured, compared with an oracle, and reported."""
