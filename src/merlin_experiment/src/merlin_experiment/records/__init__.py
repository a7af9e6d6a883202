# SPDX-License-Identifier: Apache-2.0
"""What is known about a run: records of its tasks, the true trajectory, and the files of both."""
