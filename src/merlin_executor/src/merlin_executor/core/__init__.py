"""What the Executor and its client decide: requests, verdicts, life cycles. Without ROS."""
