# SPDX-License-Identifier: Apache-2.0
"""What answers are found with, one module for each question. Without ROS."""
