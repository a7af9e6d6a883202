# SPDX-License-Identifier: Apache-2.0
"""A mission of the home that is measured while it runs."""
