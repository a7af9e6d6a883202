# SPDX-License-Identifier: Apache-2.0
"""Why the robot does what it does: answers whose claims were checked."""
