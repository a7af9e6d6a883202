# SPDX-License-Identifier: Apache-2.0
"""ROSPlan's messages to and from the pure classes."""
