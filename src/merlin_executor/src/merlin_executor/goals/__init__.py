# SPDX-License-Identifier: Apache-2.0
"""Goals of requests: their rules, and which of them the Executor has added. Without ROS."""
