# SPDX-License-Identifier: Apache-2.0
"""The panels of the page, one module each: what a panel follows over ROS. They are found, not listed."""
