# SPDX-License-Identifier: Apache-2.0
"""Looks at an installation and at the system that runs on it, and says what is wrong."""
