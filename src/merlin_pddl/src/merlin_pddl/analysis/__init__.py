# SPDX-License-Identifier: Apache-2.0
"""What can be reached in a task, and a task without some of its actions."""
