# SPDX-License-Identifier: Apache-2.0
"""A simulated store, for tests without a hub."""
