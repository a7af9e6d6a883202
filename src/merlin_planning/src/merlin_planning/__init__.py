# SPDX-License-Identifier: Apache-2.0
"""Clients of a planning system with the interfaces of ROSPlan: ours, or ROSPlan itself."""
