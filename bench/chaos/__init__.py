# SPDX-License-Identifier: Apache-2.0
"""The fault campaign: breaks a running robot in every way, at every moment, and judges what happens."""
