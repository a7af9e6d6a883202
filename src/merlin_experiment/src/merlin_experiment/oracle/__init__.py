# SPDX-License-Identifier: Apache-2.0
"""The best that a robot could do: the yardstick of the experiment."""
