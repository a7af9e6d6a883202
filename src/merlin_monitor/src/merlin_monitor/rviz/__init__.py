# SPDX-License-Identifier: Apache-2.0
"""What rviz shows of MERLIN, and the goals that are clicked there."""
