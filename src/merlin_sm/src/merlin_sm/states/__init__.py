# SPDX-License-Identifier: Apache-2.0
"""The ready states of :class:`merlin_sm.state_factory.MerlinStateFactory`."""
