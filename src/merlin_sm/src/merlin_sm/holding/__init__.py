# SPDX-License-Identifier: Apache-2.0
"""Holds state machines before states, as operators ask for it."""
