# SPDX-License-Identifier: Apache-2.0
"""MERLIN actions: state machines that a planning system dispatches."""
