# SPDX-License-Identifier: Apache-2.0
"""The file of the history, without ROS: events, and what was shown at any moment."""
