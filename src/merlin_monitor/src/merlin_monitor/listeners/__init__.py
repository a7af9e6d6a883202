# SPDX-License-Identifier: Apache-2.0
"""What panels are made of: the base class, and what it asks of ROS."""
