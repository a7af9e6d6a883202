# SPDX-License-Identifier: Apache-2.0
"""What may be said of a robot when not all that was last heard is still true. Without ROS."""
