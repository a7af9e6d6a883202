# SPDX-License-Identifier: Apache-2.0
"""Writes the systemd services of a robot's computer."""
