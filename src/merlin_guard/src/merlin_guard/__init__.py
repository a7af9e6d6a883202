# SPDX-License-Identifier: Apache-2.0
"""The velocity guard: commands reach the base only while an owned motion goal is active."""
