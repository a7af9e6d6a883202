# SPDX-License-Identifier: Apache-2.0
"""The commands `fleet` and `keys`."""
