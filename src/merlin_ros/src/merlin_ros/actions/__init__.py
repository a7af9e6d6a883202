# SPDX-License-Identifier: Apache-2.0
"""Action servers and clients whose goals are leased."""
