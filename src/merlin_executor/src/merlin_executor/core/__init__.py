# SPDX-License-Identifier: Apache-2.0
"""What the Executor and its client decide: requests, verdicts, life cycles. Without ROS."""
