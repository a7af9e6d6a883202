# SPDX-License-Identifier: Apache-2.0
"""The transport that every MERLIN node uses."""
