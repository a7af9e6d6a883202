# SPDX-License-Identifier: Apache-2.0
"""One page that shows what the robot knows, plans and does."""
