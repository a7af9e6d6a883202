# SPDX-License-Identifier: Apache-2.0
"""Records more than topics, and plays a recording again."""
