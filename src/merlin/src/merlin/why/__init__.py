# SPDX-License-Identifier: Apache-2.0
"""The command that asks a running robot why."""
